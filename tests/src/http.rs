//! Just enough HTTP/1.1 to ask a server something and read all of the answer: no pool, no redirects, a connection each.

use serde_json::Value;
use std::{
    io::{self, Read, Write},
    net::{SocketAddr, TcpStream},
    time::Duration,
};

/// How long an answer may take.
const ANSWER_TIME_MAX: Duration = Duration::from_secs(60);

/// An answer.
#[derive(Clone, Debug)]
pub struct Answer {
    /// The status.
    pub status: u16,
    /// Header names in lower case, with their values.
    pub headers: Vec<(String, String)>,
    /// The body, its chunks put together.
    pub body: Vec<u8>,
}

impl Answer {
    /// The value of a header.
    pub fn header(&self, name: &str) -> Option<&str> {
        self.headers.iter().find(|(n, _)| n == name).map(|(_, value)| value.as_str())
    }

    /// The body as JSON; null where it is none.
    pub fn json(&self) -> Value {
        serde_json::from_slice(&self.body).unwrap_or_default()
    }

    /// The body as text.
    pub fn text(&self) -> String {
        String::from_utf8_lossy(&self.body).into_owned()
    }
}

/// Asks for a resource.
///
/// # Errors
/// No connection, no answer in time, or one that is no HTTP.
pub fn get(address: SocketAddr, target: &str) -> io::Result<Answer> {
    ask(address, &format!("GET {target}"), &[], &[])
}

/// Sends a body to a resource.
///
/// # Errors
/// No connection, no answer in time, or one that is no HTTP.
pub fn post(address: SocketAddr, target: &str, content_type: &str, body: &[u8]) -> io::Result<Answer> {
    let length = body.len().to_string();
    ask(address, &format!("POST {target}"), &[("content-type", content_type), ("content-length", &length)], body)
}

/// Sends a request as it is told.
///
/// # Errors
/// No connection, no answer in time, or one that is no HTTP.
pub fn ask(address: SocketAddr, line: &str, headers: &[(&str, &str)], body: &[u8]) -> io::Result<Answer> {
    let mut stream = TcpStream::connect_timeout(&address, Duration::from_secs(5))?;
    stream.set_read_timeout(Some(ANSWER_TIME_MAX))?;
    stream.set_write_timeout(Some(ANSWER_TIME_MAX))?;
    let mut head = format!("{line} HTTP/1.1\r\nhost: {address}\r\nconnection: close\r\n");
    for (name, value) in headers {
        head.push_str(&format!("{name}: {value}\r\n"));
    }
    head.push_str("\r\n");
    // A server may answer, and close, before it has read all of a body that it refuses.
    let sent = stream.write_all(head.as_bytes()).and_then(|()| stream.write_all(body));
    let mut bytes = Vec::new();
    let read = stream.read_to_end(&mut bytes);
    match parse(&bytes, line.starts_with("HEAD ")) {
        Some(answer) => Ok(answer),
        None => Err(sent.and(read.map(drop)).err().unwrap_or_else(|| {
            let beginning = String::from_utf8_lossy(&bytes[..bytes.len().min(80)]).into_owned();
            io::Error::new(io::ErrorKind::InvalidData, format!("expected an HTTP answer, found {beginning:?}"))
        })),
    }
}

/// Reads an answer; `None` where a part of it is missing. One to `HEAD` has no body, however long it says that it is.
fn parse(bytes: &[u8], is_head: bool) -> Option<Answer> {
    let end = bytes.windows(4).position(|four| four == b"\r\n\r\n")?;
    let head = std::str::from_utf8(&bytes[..end]).ok()?;
    let mut lines = head.split("\r\n");
    let status = lines.next()?.split(' ').nth(1)?.parse().ok()?;
    let headers: Vec<(String, String)> = lines
        .filter_map(|line| line.split_once(':'))
        .map(|(name, value)| (name.to_lowercase(), value.trim().to_owned()))
        .collect();
    let rest = &bytes[end + 4..];
    let is_chunked = headers.iter().any(|(name, value)| name == "transfer-encoding" && value == "chunked");
    let declared = headers.iter().find(|(name, _)| name == "content-length" && !is_head);
    let length = declared.and_then(|(_, length)| length.parse().ok());
    let body = if is_chunked { unchunk(rest)? } else { rest.get(..length.unwrap_or(rest.len()))?.to_vec() };
    Some(Answer { status, headers, body })
}

/// Puts the chunks of a body together; `None` if the last is missing.
fn unchunk(mut rest: &[u8]) -> Option<Vec<u8>> {
    let mut body = Vec::new();
    loop {
        let end = rest.windows(2).position(|two| two == b"\r\n")?;
        let length = std::str::from_utf8(&rest[..end]).ok()?;
        let length = usize::from_str_radix(length.split(';').next()?.trim(), 16).ok()?;
        if length == 0 {
            return Some(body);
        }
        body.extend_from_slice(rest.get(end + 2..end + 2 + length)?);
        rest = rest.get(end + 2 + length + 2..)?;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn chunks_are_put_together_and_a_cut_body_is_noticed() {
        let whole = b"HTTP/1.1 200 OK\r\nTransfer-Encoding: chunked\r\n\r\n3\r\nabc\r\n2;x=y\r\nde\r\n0\r\n\r\n";
        let answer = parse(whole, false).expect("an answer");
        assert_eq!((answer.status, answer.body.as_slice()), (200, b"abcde".as_slice()));
        assert!(parse(&whole[..whole.len() - 8], false).is_none());
        let whole = b"HTTP/1.1 200 OK\r\nContent-Length: 3\r\n\r\nabc";
        assert_eq!(parse(whole, false).expect("an answer").body, b"abc");
        assert!(parse(&whole[..whole.len() - 3], true).is_some());
        assert!(parse(&whole[..whole.len() - 1], false).is_none());
    }
}
