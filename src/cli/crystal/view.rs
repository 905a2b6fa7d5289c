//! `druse crystal --view`: one page on the loopback interface that shows the model and runs modelling steps.
//!
//! Only a client that has the address may run steps and save. The server listens on 127.0.0.1 only, every
//! path begins with 128 random bits, and requests under another host name are refused, so that a foreign
//! page in the same browser cannot reach it. It writes into one directory only (`Sandbox`).
//!
//! The page is `view/page.*`; it draws by WebGL 2 (`../view/webgl.js`). It loads nothing from the network.

use super::super::{Answer, Failure, Session};
use super::{Parameters, Source};
use serde_json::json;
use state::{Refused, ViewState};
use std::io::{Read, Write};
use std::time::Duration;
use tiny_http::{Header, Method, Request, Response, Server};

mod sandbox;
mod scene;
mod state;

/// Maximum length of a request's text, in bytes.
const MAX_BODY_BYTES: u64 = 1 << 16;
/// How often the server checks for a stop signal.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// Content security policy: the page runs its own scripts and talks to its server, nothing else.
const POLICY: &str = "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; \
                      img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

const PAGE: &str = include_str!("view/page.html");
const STYLE: &str = include_str!("view/page.css");
const SCRIPT: &str = include_str!("view/page.js");
const DRAWING: &str = include_str!("view/drawing.js");
const WEBGL: &str = include_str!("../view/webgl.js");

/// The response to a request: status, content type, bytes.
type Reply = (u16, &'static str, Vec<u8>);

/// Serves the page until the page or a signal ends the session.
pub(super) fn serve(p: &Parameters, source: &Source, session: &Session) -> Result<Answer, Failure> {
    let sandbox = sandbox::Sandbox::new(&source.directory);
    let mut state = ViewState::open(source, &sandbox, session)?;
    sandbox.close();
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
        let Some(mut request) = server.recv_timeout(POLL_INTERVAL).map_err(|e| failed(&e))? else {
            continue;
        };
        let (reply, last) = answer(&mut request, port, &token, &mut state);
        send(request, reply);
        if last {
            let facts = json!({ "kind": "view", "address": address, "steps": state.steps() });
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
    // The browser may have closed the connection.
    let _ = request.respond(response);
}

fn text(status: u16, message: impl Into<String>) -> Reply {
    (
        status,
        "text/plain; charset=utf-8",
        message.into().into_bytes(),
    )
}

/// The response to a request, and whether the session ends with it.
fn answer(request: &mut Request, port: u16, token: &str, state: &mut ViewState) -> (Reply, bool) {
    let host = request.headers().iter().find(|h| h.field.equiv("Host"));
    let host = host.map_or("", |h| h.value.as_str());
    if ![format!("127.0.0.1:{port}"), format!("localhost:{port}")].contains(&host.to_owned()) {
        return (
            text(
                403,
                "this server accepts requests to 127.0.0.1 and localhost only",
            ),
            false,
        );
    }
    let url = request.url().to_owned();
    let inner = url.strip_prefix('/').and_then(|u| u.strip_prefix(token));
    let Some(path) = inner.and_then(|u| u.strip_prefix('/')) else {
        return (text(403, "expected the address that druse printed"), false);
    };
    let reply = match (request.method(), path) {
        (Method::Get, "") => (200, "text/html; charset=utf-8", PAGE.into()),
        (Method::Get, "page.css") => (200, "text/css; charset=utf-8", STYLE.into()),
        (Method::Get, "page.js") => (200, "text/javascript; charset=utf-8", SCRIPT.into()),
        (Method::Get, "drawing.js") => (200, "text/javascript; charset=utf-8", DRAWING.into()),
        (Method::Get, "webgl.js") => (200, "text/javascript; charset=utf-8", WEBGL.into()),
        (Method::Get, "words") => (200, "application/json", state::words().to_string().into()),
        (Method::Get, "model") => model(state),
        (Method::Post, "quit") => return (text(200, "bye"), true),
        (Method::Post, "step" | "again" | "undo" | "redo" | "save") => {
            match body(request).and_then(|body| act(state, path, &body)) {
                Ok(reply) => reply,
                Err(refused) => text(refused.status, refused.message),
            }
        }
        _ => text(404, "there is nothing here"),
    };
    (reply, false)
}

/// Executes the action of a request.
fn act(state: &mut ViewState, action: &str, body: &str) -> Result<Reply, Refused> {
    match action {
        "step" => state.step(body)?,
        "again" => state.again(body)?,
        "undo" => state.undo()?,
        "redo" => state.redo()?,
        _ => {
            let saved = state.save(body)?;
            return Ok((200, "application/json", saved.to_string().into()));
        }
    }
    Ok(model(state))
}

fn model(state: &mut ViewState) -> Reply {
    (200, "application/octet-stream", state.scene())
}

/// The body of a request as text.
fn body(request: &mut Request) -> Result<String, Refused> {
    let mut body = String::new();
    let read = request
        .as_reader()
        .take(MAX_BODY_BYTES + 1)
        .read_to_string(&mut body);
    if read.is_err() || body.len() as u64 > MAX_BODY_BYTES {
        let message = format!("expected at most {MAX_BODY_BYTES} bytes of text");
        return Err(Refused {
            status: 413,
            message,
        });
    }
    Ok(body)
}
