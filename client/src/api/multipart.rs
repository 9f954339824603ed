//! `multipart/form-data` (RFC 7578), as far as two parts of an upload need it.

use quadmuse_proto::id::RequestId;

/// A form under construction.
#[derive(Debug)]
pub(super) struct Form {
    boundary: String,
    body: Vec<u8>,
}

impl Form {
    /// An empty form. Its boundary holds 80 random bits, so that no file contains it.
    pub(super) fn new() -> Self {
        Self { boundary: format!("quadmuse-{}", RequestId::generate()), body: Vec::new() }
    }

    /// Adds a part.
    pub(super) fn part(mut self, name: &str, media_type: &str, bytes: &[u8]) -> Self {
        let head = format!(
            "--{}\r\nContent-Disposition: form-data; name=\"{name}\"\r\nContent-Type: {media_type}\r\n\r\n",
            self.boundary
        );
        self.body.extend_from_slice(head.as_bytes());
        self.body.extend_from_slice(bytes);
        self.body.extend_from_slice(b"\r\n");
        self
    }

    /// Its `Content-Type` and its bytes.
    pub(super) fn finish(mut self) -> (String, Vec<u8>) {
        self.body.extend_from_slice(format!("--{}--\r\n", self.boundary).as_bytes());
        (format!("multipart/form-data; boundary={}", self.boundary), self.body)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_form_is_laid_out_as_the_rfc_has_it() {
        let form = Form::new().part("mesh", "model/obj", b"v 0 0 0\n").part("segments", "text/plain", b"0\n1\n");
        let boundary = form.boundary.clone();
        let (content_type, body) = form.finish();
        assert_eq!(content_type, format!("multipart/form-data; boundary={boundary}"));
        let expected = format!(
            "--{boundary}\r\nContent-Disposition: form-data; name=\"mesh\"\r\nContent-Type: model/obj\r\n\r\nv 0 0 0\n\r\n\
             --{boundary}\r\nContent-Disposition: form-data; name=\"segments\"\r\nContent-Type: text/plain\r\n\r\n0\n1\n\r\n\
             --{boundary}--\r\n"
        );
        assert_eq!(String::from_utf8(body).expect("text"), expected);
    }
}
