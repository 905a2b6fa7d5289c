//! The server of pages on the loopback interface: one set of safety rules for every page.
//!
//! It listens on 127.0.0.1 only. Every path begins with 128 random bits. Requests under another host name, or from a
//! page of another origin, are refused, so that a foreign page in the same browser cannot reach it. Host, origin and
//! token are checked before a body is read. Sizes and times of requests are bounded. Each connection has a thread of
//! its own and carries one request, so that a slow client delays only itself.

use super::context::Session;
use super::failure::Failure;
use crate::vdb::Exhausted;
use request::{Guard, Refusal, read_request};
use std::io::{Read, Write};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, SyncSender, channel, sync_channel};
use std::time::{Duration, Instant};

mod folder;
mod request;

pub(super) use folder::inside;
pub(super) use request::{Method, Request};

/// How often the server checks for a stop signal.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Time for a client to take an answer.
const WRITE_TIME: Duration = Duration::from_secs(10);
/// Time in which the last answer is sent before the server ends.
const FAREWELL_TIME: Duration = Duration::from_secs(2);
/// Time and bytes for which the rest of a refused request is read, so that the client sees the answer.
const DRAIN_TIME: Duration = Duration::from_secs(1);
const MAX_DRAINED_BYTES: usize = 1 << 22;
/// Connections at a time; further ones are closed.
const MAX_CONNECTIONS: usize = 64;
/// Requests that wait for their turn.
const MAX_WAITING_REQUESTS: usize = 16;
/// Content security policy: a page runs its own scripts and talks to its server, nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

/// Why a request is refused: an HTTP status and a message.
pub(super) struct Refused {
    pub status: u16,
    pub message: String,
}

impl Refused {
    /// A request that is understood and cannot be carried out.
    pub fn new(message: impl Into<String>) -> Self {
        Self {
            status: 422,
            message: message.into(),
        }
    }
}

/// The answer to a request: a status of HTTP, a content, and whether the server ends after it.
pub(super) struct Reply {
    status: u16,
    content_type: &'static str,
    body: Arc<[u8]>,
    is_last: bool,
}

impl Reply {
    /// A good answer (status 200) of a MIME type.
    pub fn of(content_type: &'static str, body: impl Into<Arc<[u8]>>) -> Self {
        Self {
            status: 200,
            content_type,
            body: body.into(),
            is_last: false,
        }
    }

    /// A web page.
    pub fn html(text: &str) -> Self {
        Self::of("text/html; charset=utf-8", text.as_bytes())
    }

    /// A script.
    pub fn script(text: &str) -> Self {
        Self::of("text/javascript; charset=utf-8", text.as_bytes())
    }

    /// A style sheet.
    pub fn style(text: &str) -> Self {
        Self::of("text/css; charset=utf-8", text.as_bytes())
    }

    /// An object.
    pub fn json(value: &serde_json::Value) -> Self {
        Self::of("application/json", value.to_string().into_bytes())
    }

    /// Numbers.
    pub fn bytes(body: impl Into<Arc<[u8]>>) -> Self {
        Self::of("application/octet-stream", body)
    }

    /// A line of text with a status.
    pub fn text(status: u16, message: &str) -> Self {
        Self {
            status,
            ..Self::of("text/plain; charset=utf-8", message.as_bytes())
        }
    }

    /// The answer to a path that is none.
    pub fn nothing() -> Self {
        Self::text(404, "there is nothing here")
    }

    /// The same answer, after which the server ends.
    pub fn last(self) -> Self {
        Self {
            is_last: true,
            ..self
        }
    }
}

impl From<Result<Self, Refused>> for Reply {
    fn from(result: Result<Self, Refused>) -> Self {
        result.unwrap_or_else(|r| Self::text(r.status, &r.message))
    }
}

/// A request that waits for its answer.
struct Waiting {
    request: Request,
    answer: SyncSender<Reply>,
    sent: Receiver<()>,
}

/// A server that listens.
pub(super) struct Server {
    listener: TcpListener,
    guard: Arc<Guard>,
    address: String,
}

impl Server {
    /// Listens on a port of 127.0.0.1; 0 means a free one.
    pub fn open(port: u16) -> Result<Self, Failure> {
        let failed =
            |e: std::io::Error| Failure::usage(format!("cannot serve on 127.0.0.1:{port}: {e}"));
        let listener = TcpListener::bind(("127.0.0.1", port)).map_err(failed)?;
        let port = listener.local_addr().map_err(failed)?.port();
        let token = token().map_err(failed)?;
        Ok(Self {
            address: format!("http://127.0.0.1:{port}/{token}/"),
            guard: Arc::new(Guard { port, token }),
            listener,
        })
    }

    /// The address of the page.
    pub fn address(&self) -> &str {
        &self.address
    }

    /// Prints the address.
    pub fn announce(&self, session: &Session) {
        if session.json() {
            session.note(&self.address);
            return;
        }
        let mut out = std::io::stdout();
        let _ = writeln!(out, "{}", self.address);
        let _ = out.flush();
        session.note("open that address in a browser; Ctrl-C ends");
    }

    /// Answers requests one by one with `answer`, until an answer is the last one or a signal arrives, which is a
    /// failure. Connections are read on threads of their own.
    pub fn serve(
        self,
        session: &Session,
        mut answer: impl FnMut(&Request) -> Reply,
    ) -> Result<(), Failure> {
        let (requests, waiting) = sync_channel::<Waiting>(MAX_WAITING_REQUESTS);
        let is_closed = Arc::new(AtomicBool::new(false));
        let port = self.guard.port;
        let accepting = {
            let is_closed = Arc::clone(&is_closed);
            std::thread::Builder::new()
                .spawn(move || accept(&self.listener, &self.guard, &requests, &is_closed))
                .map_err(|_| Failure::exhausted(Exhausted::Threads))?
        };
        let ended = loop {
            if session.signals.stopped() {
                break Err(Failure::stopped(130));
            }
            let next = match waiting.recv_timeout(POLL_INTERVAL) {
                Ok(next) => next,
                Err(RecvTimeoutError::Timeout) => continue,
                Err(RecvTimeoutError::Disconnected) => {
                    break Err(Failure::usage("the server has lost its socket"));
                }
            };
            let reply = answer(&next.request);
            let is_last = reply.is_last;
            let _ = next.answer.send(reply);
            if is_last {
                let _ = next.sent.recv_timeout(FAREWELL_TIME);
                break Ok(());
            }
        };
        is_closed.store(true, Ordering::Relaxed);
        // A connection wakes the thread that accepts.
        let _ = TcpStream::connect(("127.0.0.1", port));
        let _ = accepting.join();
        ended
    }
}

/// 128 random bits in hexadecimal digits.
fn token() -> std::io::Result<String> {
    let mut bits = [0u8; 16];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut bits)?;
    Ok(format!("{:032x}", u128::from_be_bytes(bits)))
}

/// Accepts connections until the server is closed, each on a thread of its own; `requests` takes what they read.
fn accept(
    listener: &TcpListener,
    guard: &Arc<Guard>,
    requests: &SyncSender<Waiting>,
    is_closed: &AtomicBool,
) {
    let open = Arc::new(AtomicUsize::new(0));
    for stream in listener.incoming() {
        if is_closed.load(Ordering::Relaxed) {
            return;
        }
        let Ok(stream) = stream else {
            // Too many open files, for example.
            std::thread::sleep(POLL_INTERVAL);
            continue;
        };
        if open.load(Ordering::Relaxed) >= MAX_CONNECTIONS {
            continue;
        }
        open.fetch_add(1, Ordering::Relaxed);
        let (guard, requests) = (Arc::clone(guard), requests.clone());
        let answering = {
            let open = Arc::clone(&open);
            std::thread::Builder::new().spawn(move || {
                converse(stream, &guard, &requests);
                open.fetch_sub(1, Ordering::Relaxed);
            })
        };
        // Without a thread the connection is closed.
        if answering.is_err() {
            open.fetch_sub(1, Ordering::Relaxed);
        }
    }
}

/// Reads the request of a connection, waits for its answer and writes it. Errors of the connection end it without
/// a trace: the client is gone.
fn converse(mut stream: TcpStream, guard: &Guard, requests: &SyncSender<Waiting>) {
    let _ = stream.set_nodelay(true);
    let _ = stream.set_write_timeout(Some(WRITE_TIME));
    let request = match read_request(&mut stream, guard) {
        Ok(request) => request,
        Err(Refusal::Gone) => return,
        Err(Refusal::With(refused)) => {
            let reply = Reply::text(refused.status, &refused.message);
            if write(&mut stream, &reply).is_ok() {
                // The rest of a refused request is read, else the browser may lose the answer.
                drain(&mut stream);
            }
            return;
        }
    };
    // The thread of the page makes the answer; `sent` reports that it is written, so that the program may end.
    let ((answer, answered), (sent, receipt)) = (sync_channel(1), channel());
    let waiting = Waiting {
        request,
        answer,
        sent: receipt,
    };
    if requests.send(waiting).is_err() {
        return;
    }
    if let Ok(reply) = answered.recv() {
        let _ = write(&mut stream, &reply);
        let _ = stream.shutdown(Shutdown::Write);
        let _ = sent.send(());
    }
}

/// Writes the head and the body of an answer. The headers allow nothing from elsewhere, and no copies.
fn write(stream: &mut TcpStream, reply: &Reply) -> std::io::Result<()> {
    let reason = match reply.status {
        200 => "OK",
        400 => "Bad Request",
        403 => "Forbidden",
        404 => "Not Found",
        405 => "Method Not Allowed",
        408 => "Request Timeout",
        409 => "Conflict",
        411 => "Length Required",
        413 => "Content Too Large",
        431 => "Request Header Fields Too Large",
        _ => "Unprocessable Content",
    };
    let head = format!(
        "HTTP/1.1 {} {reason}\r\nContent-Type: {}\r\nContent-Length: {}\r\nConnection: close\r\n\
         Content-Security-Policy: {POLICY}\r\nCache-Control: no-store\r\nX-Content-Type-Options: nosniff\r\n\
         Referrer-Policy: no-referrer\r\nCross-Origin-Resource-Policy: same-origin\r\n\
         Cross-Origin-Opener-Policy: same-origin\r\n\r\n",
        reply.status,
        reply.content_type,
        reply.body.len(),
    );
    let mut answer = head.into_bytes();
    answer.extend(&reply.body[..]);
    stream.write_all(&answer)
}

/// Reads the rest of a refused request: a socket that is closed with unread bytes resets the connection, and the
/// client would not see the answer.
fn drain(stream: &mut TcpStream) {
    let _ = stream.shutdown(Shutdown::Write);
    let end = Instant::now() + DRAIN_TIME;
    let mut bytes = [0u8; 1 << 14];
    let mut count = 0;
    while count < MAX_DRAINED_BYTES {
        let left = end.saturating_duration_since(Instant::now());
        if left.is_zero() || stream.set_read_timeout(Some(left)).is_err() {
            return;
        }
        match stream.read(&mut bytes) {
            Ok(0) | Err(_) => return,
            Ok(n) => count += n,
        }
    }
}

/// The head of a binary answer: the length of a description in bytes (u32, little-endian), and the description as
/// JSON. Spaces fill it to a multiple of 4, so that the numbers behind it are aligned for the page's typed arrays.
pub(super) fn headed(about: &serde_json::Value) -> Vec<u8> {
    let mut text = about.to_string();
    while !text.len().is_multiple_of(4) {
        text.push(' ');
    }
    let mut bytes = (text.len() as u32).to_le_bytes().to_vec();
    bytes.extend(text.bytes());
    bytes
}
