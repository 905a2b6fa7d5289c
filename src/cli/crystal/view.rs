//! `druse crystal --view`: one page that shows the model and runs modelling steps.
//!
//! Only a client that has the address may run steps and save: [`Server`] has the rules. It writes into one directory
//! only (`Sandbox`). The page is `view/page.*` and the parts that it shares with `druse view`: style, camera, pointer,
//! keys and WebGL. It loads nothing from the network.

use super::super::server::{Method, Refused, Reply, Request, Server};
use super::{Parameters, Source};
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::cli::output::Answer;
use serde_json::json;
use state::ViewState;

mod sandbox;
mod scene;
mod state;

const PAGE: &str = include_str!("view/page.html");
/// The style sheets, in order.
const STYLES: [&str; 2] = [
    include_str!("../view/page.css"),
    include_str!("view/page.css"),
];
/// The scripts, in order.
const SCRIPTS: [&str; 6] = [
    include_str!("../view/kit.js"),
    include_str!("../view/webgl.js"),
    include_str!("../view/camera.js"),
    include_str!("../view/controls.js"),
    include_str!("view/drawing.js"),
    include_str!("view/page.js"),
];

/// Serves the page until the page or a signal ends the session.
pub(super) fn serve(p: &Parameters, source: &Source, session: &Session) -> Result<Answer, Failure> {
    let sandbox = sandbox::Sandbox::new(&source.directory);
    let mut state = ViewState::open(source, &sandbox, session)?;
    sandbox.close();
    let server = Server::open(p.port)?;
    server.announce(session);
    let address = server.address().to_owned();
    server.serve(session, |request| answer(request, &mut state))?;
    let facts = json!({ "kind": "view", "address": address, "steps": state.steps() });
    Ok(Answer::new("", facts))
}

fn answer(request: &Request, state: &mut ViewState) -> Reply {
    match (request.method, request.path.as_str()) {
        (Method::Get, "") => Reply::html(PAGE),
        (Method::Get, "page.css") => Reply::style(&STYLES.concat()),
        (Method::Get, "page.js") => Reply::script(&SCRIPTS.concat()),
        (Method::Get, "words") => Reply::json(&state::words()),
        (Method::Get, "model") => Reply::bytes(state.scene()),
        (Method::Post, "quit") => Reply::text(200, "bye").last(),
        (Method::Post, action @ ("step" | "again" | "undo" | "redo" | "save")) => {
            act(state, action, &request.body).into()
        }
        _ => Reply::nothing(),
    }
}

/// Executes the action of a request.
fn act(state: &mut ViewState, action: &str, body: &str) -> Result<Reply, Refused> {
    match action {
        "step" => state.step(body)?,
        "again" => state.again(body)?,
        "undo" => state.undo()?,
        "redo" => state.redo()?,
        _ => return Ok(Reply::json(&state.save(body)?)),
    }
    Ok(Reply::bytes(state.scene()))
}
