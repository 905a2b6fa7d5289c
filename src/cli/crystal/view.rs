//! `druse crystal --view`: one page on the loopback interface that shows the model and takes steps.
//!
//! Whoever has the address may step and save, nobody else: the server listens on 127.0.0.1 only, every path
//! begins with 128 random bits, and requests under another host's name are refused, so that a page of
//! somebody else's in the same browser cannot reach it. It writes below one directory only (`Fence`).
//!
//! The page is `view/page.*`; it draws with twgl.js 7.0.0 (npm, MIT: `view/twgl.LICENSE.md`), of which
//! `view/twgl.js` is the release file `dist/7.x/twgl.js`, unchanged. Nothing is fetched from elsewhere.

use super::super::{Answer, Failure, Session};
use super::{Parameters, Source};
use serde_json::json;
use state::{Desk, Refused};
use std::io::{Read, Write};
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, Server};

mod sandbox;
mod scene;
mod state;

/// Most bytes of a step.
const MOST: u64 = 1 << 16;
/// How often the server looks whether it shall stop.
const PATIENCE: Duration = Duration::from_millis(100);
/// What the page may do: run its own two scripts, and talk to its server.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const PAGE: &str = include_str!("view/page.html");
const STYLE: &str = include_str!("view/page.css");
const SCRIPT: &str = include_str!("view/page.js");
const DRAWING: &str = include_str!("view/drawing.js");
const LIBRARY: &str = include_str!("view/twgl.js");

/// An answer to a request: status, type, bytes.
type Reply = (u16, &'static str, Vec<u8>);

/// Serves the page until it or a signal says stop.
pub(super) fn serve(p: &Parameters, source: &Source, session: &Session) -> Result<Answer, Failure> {
    let fence = sandbox::Fence::new(&source.directory);
    let mut desk = Desk::open(source, &fence, session)?;
    fence.close();
    let failed = |e: &dyn std::fmt::Display| {
        Failure::usage(format!("cannot serve on 127.0.0.1:{}: {e}", p.port))
    };
    let server = Server::http(("127.0.0.1", p.port)).map_err(|e| failed(&e))?;
    let port = server.server_addr().to_ip().map_or(p.port, |a| a.port());
    let token = token().map_err(|e| failed(&e))?;
    let address = format!("http://127.0.0.1:{port}/{token}/");
    if session.json() {
        session.note(&address);
    } else {
        let _ = writeln!(std::io::stdout(), "{address}");
        let _ = std::io::stdout().flush();
        session.note("open that address in a browser; Ctrl-C ends");
    }
    loop {
        if session.signals.stopped() {
            return Err(Failure::stopped(130));
        }
        let Some(mut request) = server.recv_timeout(PATIENCE).map_err(|e| failed(&e))? else {
            continue;
        };
        let (reply, last) = answer(&mut request, port, &token, &mut desk);
        send(request, reply);
        if last {
            let facts = json!({ "kind": "view", "address": address, "steps": desk.steps() });
            return Ok(Answer::new("", facts));
        }
    }
}

/// 128 random bits in hexadecimal digits.
fn token() -> std::io::Result<String> {
    let mut bits = [0u8; 16];
    std::fs::File::open("/dev/urandom")?.read_exact(&mut bits)?;
    Ok(format!("{:032x}", u128::from_be_bytes(bits)))
}

fn send(request: Request, (status, kind, body): Reply) {
    let header = |name: &str, value: &str| Header::from_bytes(name, value);
    let headers = [
        header("Content-Type", kind),
        header("Content-Security-Policy", POLICY),
        header("Cache-Control", "no-store"),
        header("X-Content-Type-Options", "nosniff"),
        header("Referrer-Policy", "no-referrer"),
    ];
    let mut response = Response::from_data(body).with_status_code(status);
    for header in headers.into_iter().flatten() {
        response.add_header(header);
    }
    // A browser that has gone needs no answer.
    let _ = request.respond(response);
}

fn text(status: u16, message: impl Into<String>) -> Reply {
    (
        status,
        "text/plain; charset=utf-8",
        message.into().into_bytes(),
    )
}

/// The answer to a request, and whether it was the last.
fn answer(request: &mut Request, port: u16, token: &str, desk: &mut Desk) -> (Reply, bool) {
    let host = request.headers().iter().find(|h| h.field.equiv("Host"));
    let host = host.map_or("", |h| h.value.as_str());
    if ![format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&host.to_owned()) {
        return (text(403, "this server answers to its own name only"), false);
    }
    let url = request.url().to_owned();
    let inner = url.strip_prefix('/').and_then(|u| u.strip_prefix(token));
    let Some(what) = inner.and_then(|u| u.strip_prefix('/')) else {
        return (text(403, "expected the address that druse printed"), false);
    };
    let reply = match (request.method(), what) {
        (Method::Get, "") => (200, "text/html; charset=utf-8", PAGE.into()),
        (Method::Get, "page.css") => (200, "text/css; charset=utf-8", STYLE.into()),
        (Method::Get, "page.js") => (200, "text/javascript; charset=utf-8", SCRIPT.into()),
        (Method::Get, "drawing.js") => (200, "text/javascript; charset=utf-8", DRAWING.into()),
        (Method::Get, "twgl.js") => (200, "text/javascript; charset=utf-8", LIBRARY.into()),
        (Method::Get, "words") => (200, "application/json", state::words().to_string().into()),
        (Method::Get, "model") => model(desk),
        (Method::Post, "quit") => return (text(200, "bye"), true),
        (Method::Post, "step" | "again" | "undo" | "redo" | "save") => {
            match body(request).and_then(|body| act(desk, what, &body)) {
                Ok(reply) => reply,
                Err(refused) => text(refused.status, refused.message),
            }
        }
        _ => text(404, "there is nothing here"),
    };
    (reply, false)
}

/// Does what a request asks for.
fn act(desk: &mut Desk, what: &str, body: &str) -> Result<Reply, Refused> {
    match what {
        "step" => desk.step(body)?,
        "again" => desk.again(body)?,
        "undo" => desk.undo()?,
        "redo" => desk.redo()?,
        _ => {
            let said = desk.save(body)?;
            return Ok((200, "application/json", said.to_string().into()));
        }
    }
    Ok(model(desk))
}

fn model(desk: &mut Desk) -> Reply {
    (200, "application/octet-stream", desk.scene())
}

/// The text that a request carries.
fn body(request: &mut Request) -> Result<String, Refused> {
    let mut body = String::new();
    let read = request.as_reader().take(MOST + 1).read_to_string(&mut body);
    if read.is_err() || body.len() as u64 > MOST {
        let message = format!("expected at most {MOST} bytes of text");
        return Err(Refused {
            status: 413,
            message,
        });
    }
    Ok(body)
}
