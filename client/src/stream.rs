//! Readers of event streams: bytes in, in whatever pieces they come; events out.
//!
//! SSE as the HTML standard has it (`event`, `id`, `data`, comments, CR, LF or both), as far as the service uses it;
//! NDJSON, one object a line, blank lines being heartbeats.

use quadmuse_proto::Event;

/// Longest line that is waited for: a ranking of a thousand entries has some 300 kB.
pub const LINE_BYTES_MAX: usize = 16 * 1024 * 1024;

/// A stream that cannot be read on.
#[derive(Debug, thiserror::Error)]
pub enum StreamFault {
    /// A line is longer than [`LINE_BYTES_MAX`].
    #[error(
        "expected lines of at most {LINE_BYTES_MAX} bytes, found a longer one; see whether the address is that of a Quadmuse server"
    )]
    LineTooLong,
    /// An object is none of the events.
    #[error("expected an event, found `{found}`; see whether client and server are of one version")]
    NotAnEvent {
        /// The beginning of what came.
        found: String,
        /// Where it differs.
        source: serde_json::Error,
    },
}

/// How a stream is written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StreamFormat {
    /// `text/event-stream`.
    Sse,
    /// `application/x-ndjson`.
    Ndjson,
}

impl StreamFormat {
    /// What to send as `Accept`.
    pub const ACCEPT: &str = "application/x-ndjson, text/event-stream;q=0.5";

    /// The format of a media type.
    pub fn from_media_type(text: &str) -> Option<Self> {
        match text.split(';').next().unwrap_or_default().trim().to_ascii_lowercase().as_str() {
            "text/event-stream" => Some(Self::Sse),
            "application/x-ndjson" | "application/ndjson" | "application/jsonl" => Some(Self::Ndjson),
            _ => None,
        }
    }
}

/// Turns the bytes of a stream into its events.
#[derive(Debug)]
pub struct EventReader {
    format: StreamFormat,
    lines: Lines,
    data: String,
}

impl EventReader {
    /// A reader at the beginning of a stream.
    pub fn new(format: StreamFormat) -> Self {
        Self { format, lines: Lines::default(), data: String::new() }
    }

    /// Takes the next bytes; answers with the events they complete.
    ///
    /// # Errors
    /// [`StreamFault`]; then the stream can't be read on.
    pub fn push(&mut self, bytes: &[u8]) -> Result<Vec<Event>, StreamFault> {
        self.lines.push(bytes);
        let mut events = Vec::new();
        while let Some(line) = self.lines.next()? {
            events.extend(self.take_line(&line)?);
        }
        Ok(events)
    }

    fn take_line(&mut self, line: &str) -> Result<Option<Event>, StreamFault> {
        match self.format {
            StreamFormat::Ndjson if line.trim().is_empty() => Ok(None),
            StreamFormat::Ndjson => event(line).map(Some),
            StreamFormat::Sse if line.is_empty() => {
                let data = std::mem::take(&mut self.data);
                if data.is_empty() { Ok(None) } else { event(&data).map(Some) }
            }
            StreamFormat::Sse => {
                // `event:` and `id:` repeat what the object says; other fields and comments mean nothing here.
                if let Some(value) = line.strip_prefix("data:") {
                    if !self.data.is_empty() {
                        self.data.push('\n');
                    }
                    self.data.push_str(value.strip_prefix(' ').unwrap_or(value));
                }
                if self.data.len() > LINE_BYTES_MAX { Err(StreamFault::LineTooLong) } else { Ok(None) }
            }
        }
    }
}

fn event(text: &str) -> Result<Event, StreamFault> {
    serde_json::from_str(text)
        .map_err(|source| StreamFault::NotAnEvent { found: text.chars().take(80).collect(), source })
}

/// Cuts bytes into lines that end in LF, CR LF or CR.
#[derive(Debug, Default)]
struct Lines {
    buffer: Vec<u8>,
    searched: usize,
    after_cr: bool,
}

impl Lines {
    fn push(&mut self, bytes: &[u8]) {
        self.buffer.extend_from_slice(bytes);
    }

    fn next(&mut self) -> Result<Option<String>, StreamFault> {
        if self.after_cr && !self.buffer.is_empty() {
            // The LF of a CR LF may come in the next piece.
            self.after_cr = false;
            if self.buffer.first() == Some(&b'\n') {
                self.buffer.remove(0);
            }
        }
        let end = self.buffer.iter().skip(self.searched).position(|&b| b == b'\n' || b == b'\r');
        let Some(end) = end.map(|at| at + self.searched) else {
            self.searched = self.buffer.len();
            return if self.searched > LINE_BYTES_MAX { Err(StreamFault::LineTooLong) } else { Ok(None) };
        };
        let rest = self.buffer.split_off(end + 1);
        let mut line = std::mem::replace(&mut self.buffer, rest);
        self.after_cr = line.pop() == Some(b'\r');
        self.searched = 0;
        Ok(Some(String::from_utf8_lossy(&line).into_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use quadmuse_proto::{Begin, QueryId, QueryState, Ranking};

    fn events() -> Vec<Event> {
        let query = QueryId::generate();
        let (state, entries) = (QueryState::Ranking, Vec::new());
        let (incomplete, corpus_size) = (Vec::new(), 9);
        let ranking = Ranking {
            query,
            segment: 0,
            segment_name: None,
            revision: 3,
            level: 32,
            resolution: 128,
            state,
            entries,
            corpus_size,
            incomplete,
        };
        vec![Event::Begin(Begin { query, segments: 1, resolution: 128, corpus_size: 9 }), Event::Level(ranking)]
    }

    fn json(event: &Event) -> String {
        serde_json::to_string(event).expect("prints")
    }

    /// Feeds `text` in pieces of every size from 1 to 7 and as a whole.
    fn read(format: StreamFormat, text: &str) -> Vec<Event> {
        let mut answers = Vec::new();
        for size in (1..8).chain([text.len().max(1)]) {
            let mut reader = EventReader::new(format);
            let pieces = text.as_bytes().chunks(size);
            let found: Vec<Event> = pieces.flat_map(|piece| reader.push(piece).expect("reads")).collect();
            answers.push(found);
        }
        assert!(answers.windows(2).all(|pair| pair[0] == pair[1]), "the pieces make a difference");
        answers.remove(0)
    }

    #[test]
    fn ndjson_is_read_in_any_pieces_and_blank_lines_are_heartbeats() {
        let events = events();
        let text = format!("{}\n\n\r\n{}\r\n \n", json(&events[0]), json(&events[1]));
        assert_eq!(read(StreamFormat::Ndjson, &text), events);
    }

    #[test]
    fn sse_is_read_with_any_line_ending_comments_and_split_data() {
        let events = events();
        for end in ["\n", "\r\n", "\r"] {
            let level = json(&events[1]);
            let (first, second) = level.split_at(level.find(',').expect("a comma") + 1);
            let text = [
                ": heartbeat",
                "",
                "event: begin",
                "id: 0",
                &format!("data: {}", json(&events[0])),
                "",
                "retry: 100",
                "",
                &format!("data:{first}"),
                &format!("data: {second}"),
                "id: 3",
                "",
                "",
            ]
            .join(end);
            // A lone CR at the very end can't be told from half a CR LF, so one more byte follows.
            assert_eq!(read(StreamFormat::Sse, &format!("{text}:")), events, "{end:?}");
        }
    }

    #[test]
    fn half_an_event_is_no_event() {
        let text = json(&events()[0]);
        assert_eq!(read(StreamFormat::Ndjson, &text), []);
        assert_eq!(read(StreamFormat::Sse, &format!("data: {text}\n")), []);
    }

    #[test]
    fn what_is_no_event_is_refused_with_its_beginning() {
        let mut reader = EventReader::new(StreamFormat::Ndjson);
        let fault = reader.push(b"<html>\n").expect_err("no event");
        assert!(fault.to_string().contains("<html>"), "{fault}");
    }

    #[test]
    fn a_line_without_end_is_refused() {
        let mut reader = EventReader::new(StreamFormat::Ndjson);
        let piece = vec![b' '; 1 << 20];
        let fault = (0..32).find_map(|_| reader.push(&piece).err());
        assert!(matches!(fault, Some(StreamFault::LineTooLong)));
    }
}
