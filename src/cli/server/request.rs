//! Reading one request from a connection, within limits of size and time. Only what the pages send is understood:
//! GET and POST of HTTP 1 with a short body of text.

use super::Refused;
use std::io::Read;
use std::net::TcpStream;
use std::time::{Duration, Instant};

/// Longest head, the line of the request with all headers, bytes; it may be passed by what one read holds.
const MAX_HEAD_BYTES: usize = 1 << 14;
/// Longest body, bytes.
const MAX_BODY_BYTES: usize = 1 << 16;
/// Time for a client to send a request.
const READ_TIME: Duration = Duration::from_secs(5);

/// What the request does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cli) enum Method {
    Get,
    Post,
}

/// A request that the rules allow.
pub(in crate::cli) struct Request {
    pub method: Method,
    /// The path behind the token; the query is not part of it.
    pub path: String,
    pub body: String,
}

/// Who may send requests.
pub(super) struct Guard {
    pub port: u16,
    pub token: String,
}

/// Why no request was read.
pub(super) enum Refusal {
    /// The client has closed the connection.
    Gone,
    /// The answer to it.
    With(Refused),
}

/// The refusal of a request with a status of HTTP and a message.
fn refuse<T>(status: u16, message: impl Into<String>) -> Result<T, Refusal> {
    Err(Refusal::With(Refused {
        status,
        message: message.into(),
    }))
}

/// Reads bytes until a deadline.
struct TimedReader<'a> {
    stream: &'a mut TcpStream,
    end: Instant,
}

impl TimedReader<'_> {
    /// Reads some bytes, at least one, before the deadline.
    fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Refusal> {
        let left = self.end.saturating_duration_since(Instant::now());
        if left.is_zero() || self.stream.set_read_timeout(Some(left)).is_err() {
            return refuse(408, "expected the whole request within 5 seconds");
        }
        match self.stream.read(bytes) {
            Ok(0) => Err(Refusal::Gone),
            Ok(n) => Ok(n),
            Err(e) if is_timeout(&e) => refuse(408, "expected the whole request within 5 seconds"),
            Err(_) => Err(Refusal::Gone),
        }
    }
}

/// Whether a read has ended for its deadline; systems differ in the kind of error.
fn is_timeout(e: &std::io::Error) -> bool {
    use std::io::ErrorKind::{TimedOut, WouldBlock};
    matches!(e.kind(), TimedOut | WouldBlock)
}

/// Reads the request of a connection, checks who sends it, and reads its body. The refusal has the status and text
/// of the answer; a Content-Length that is no number counts as too long (413).
pub(super) fn read_request(stream: &mut TcpStream, guard: &Guard) -> Result<Request, Refusal> {
    let mut reader = TimedReader {
        stream,
        end: Instant::now() + READ_TIME,
    };
    let (head, mut body) = read_head(&mut reader)?;
    let mut lines = head.split("\r\n");
    let first: Vec<&str> = lines.next().unwrap_or_default().split(' ').collect();
    let [method, target, "HTTP/1.1" | "HTTP/1.0"] = first[..] else {
        return refuse(400, "expected a request of HTTP 1");
    };
    let mut headers = Vec::new();
    for line in lines {
        let Some((name, value)) = line.split_once(':') else {
            return refuse(400, "expected headers of the form NAME: VALUE");
        };
        headers.push((name, value.trim()));
    }
    // Before the body is read, so that others cost no memory.
    let path = guard.admit(target, &headers)?;
    let method = match method {
        "GET" => Method::Get,
        "POST" => Method::Post,
        _ => return refuse(405, "expected GET or POST"),
    };
    // A body in chunks has no length to limit.
    if header(&headers, "Transfer-Encoding").next().is_some() {
        return refuse(411, "expected a body with a Content-Length");
    }
    let length = match header(&headers, "Content-Length").collect::<Vec<_>>()[..] {
        [] => 0,
        [length] => match length.parse::<usize>() {
            Ok(length) if length <= MAX_BODY_BYTES => length,
            _ => {
                let message = format!("expected at most {MAX_BODY_BYTES} bytes of text");
                return refuse(413, message);
            }
        },
        _ => return refuse(400, "expected one Content-Length"),
    };
    // The first read may hold a part of the body behind the head.
    while body.len() < length {
        let mut bytes = [0u8; 4096];
        let count = reader.read(&mut bytes)?;
        body.extend(&bytes[..count]);
    }
    body.truncate(length);
    match String::from_utf8(body) {
        Ok(body) => Ok(Request {
            method,
            path: path.to_owned(),
            body,
        }),
        Err(_) => refuse(400, "expected text in UTF-8"),
    }
}

/// The request line with all headers, without the empty line that ends them, and the bytes after it.
fn read_head(reader: &mut TimedReader) -> Result<(String, Vec<u8>), Refusal> {
    let mut bytes = Vec::new();
    loop {
        let mut some = [0u8; 2048];
        let count = reader.read(&mut some)?;
        // The end mark of four bytes may begin in the last three of the read before.
        let start = bytes.len().saturating_sub(3);
        bytes.extend(&some[..count]);
        let end = bytes[start..].windows(4).position(|w| w == b"\r\n\r\n");
        if let Some(end) = end {
            let rest = bytes.split_off(start + end + 4);
            bytes.truncate(start + end);
            return match String::from_utf8(bytes) {
                Ok(head) => Ok((head, rest)),
                Err(_) => refuse(400, "expected headers in ASCII"),
            };
        }
        if bytes.len() > MAX_HEAD_BYTES {
            let message = format!("expected at most {MAX_HEAD_BYTES} bytes of headers");
            return refuse(431, message);
        }
    }
}

/// The values of a header, in any case of letters; there may be several.
fn header<'a>(headers: &'a [(&str, &'a str)], name: &'a str) -> impl Iterator<Item = &'a str> {
    headers
        .iter()
        .filter(move |h| h.0.eq_ignore_ascii_case(name))
        .map(|h| h.1)
}

impl Guard {
    /// The path behind the token, without a query, if host, origin and token are right. Without the header Origin,
    /// as requests of a typed address have none, host and token decide.
    fn admit<'a>(&self, target: &'a str, headers: &[(&str, &str)]) -> Result<&'a str, Refusal> {
        let names = ["127.0.0.1", "localhost"].map(|name| format!("{name}:{}", self.port));
        let hosts: Vec<&str> = header(headers, "Host").collect();
        if hosts.len() != 1 || !names.iter().any(|n| n == hosts[0]) {
            let message = "this server accepts requests to 127.0.0.1 and localhost only";
            return refuse(403, message);
        }
        let is_own = |origin: &str| {
            let name = origin.strip_prefix("http://");
            name.is_some_and(|name| names.iter().any(|n| n == name))
        };
        if !header(headers, "Origin").all(is_own) {
            return refuse(403, "this server accepts requests of its own pages only");
        }
        let inner = target.strip_prefix('/').filter(|t| self.has_token(t));
        let path = inner.and_then(|t| t.get(self.token.len()..)?.strip_prefix('/'));
        match path {
            Some(path) => Ok(path.split(['?', '#']).next().unwrap_or_default()),
            None => refuse(403, "expected the address that druse printed"),
        }
    }

    /// Whether a text begins with the token; the time does not depend on how much of it is right.
    fn has_token(&self, text: &str) -> bool {
        let (text, token) = (text.as_bytes(), self.token.as_bytes());
        let differences = text.iter().zip(token).fold(0, |sum, (a, b)| sum | (a ^ b));
        text.len() >= token.len() && differences == 0
    }
}
