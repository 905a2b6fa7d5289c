//! The live page: a server, and the thread that computes what it shows. Requests only read or change the state of
//! the work and answer at once; nothing is computed while one waits, except for slices.

use super::recipe_text::RecipeText;
use super::work::{Subject, Work, no_recipe};
use super::{Parameters, levels, load, page};
use crate::cli::context::Session;
use crate::cli::failure::Failure;
use crate::cli::output::Answer;
use crate::cli::server::{Method, Refused, Reply, Request, Server};
use crate::vdb::Exhausted;
use serde_json::json;
use std::sync::Arc;
use std::thread::{Builder, Scope};

/// Serves the page of a file or a recipe until the page or a signal ends it.
pub(super) fn serve(p: &Parameters, session: &Session) -> Result<Answer, Failure> {
    let is_recipe = p
        .file
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("toml"));
    let subject = if is_recipe {
        Subject::Recipe(RecipeText::open(&p.file)?)
    } else {
        load::check(&p.file)?;
        Subject::File
    };
    let work = Work::new(p, session, subject)?;
    let server = Server::open(p.port)?;
    let address = server.address().to_owned();
    server.announce(session);
    // One thread computes while this one answers requests; the end of the server stops both.
    let served = std::thread::scope(|scope| {
        Builder::new()
            .spawn_scoped(scope, || work.run())
            .map_err(|_| Failure::exhausted(Exhausted::Threads))?;
        let served = server.serve(session, |request| answer(request, &work, scope));
        work.stop();
        served
    });
    served?;
    Ok(Answer::new(
        "",
        json!({ "kind": "view", "address": address }),
    ))
}

/// The answer to a request, by its method and its path behind the token.
fn answer<'scope, 'a: 'scope>(
    request: &Request,
    work: &'scope Work<'a>,
    scope: &'scope Scope<'scope, '_>,
) -> Reply {
    let title = work
        .p
        .file
        .file_name()
        .unwrap_or_default()
        .to_string_lossy();
    match (request.method, request.path.as_str()) {
        (Method::Get, "") => Reply::html(&page::live(&title)),
        (Method::Get, "page.css") => Reply::style(page::style()),
        (Method::Get, "page.js") => Reply::script(&page::live_script()),
        (Method::Get, "state") => Reply::json(&work.describe()),
        (Method::Get, "scene") => scene(work),
        (Method::Get, "controls") => controls(work).into(),
        (Method::Get, "recipe") => recipe(work).into(),
        (Method::Post, "set") => set(work, &request.body).into(),
        (Method::Post, "cancel") => {
            work.cancel();
            Reply::json(&work.describe())
        }
        (Method::Post, "slice") => slice(work, &request.body).into(),
        (Method::Post, "save") => levels::save(work, &request.body)
            .map(|saved| Reply::json(&saved))
            .into(),
        (Method::Post, "run") => run(work, scope).into(),
        // A new number makes the run with the former one stop.
        (Method::Post, "stop") => {
            work.full.next();
            Reply::json(&work.describe())
        }
        (Method::Post, "quit") => Reply::text(200, "bye").last(),
        _ => Reply::nothing(),
    }
}

/// The last scene that was published, in binary.
fn scene(work: &Work) -> Reply {
    let published = work.state().published.clone();
    published.map_or_else(
        || Reply::text(404, "nothing is computed yet"),
        |p| Reply::bytes(p.bytes),
    )
}

/// The recipe of the page; a file has none.
fn recipe_of<'w>(work: &'w Work) -> Result<&'w RecipeText, Refused> {
    match &work.subject {
        Subject::Recipe(recipe) => Ok(recipe),
        Subject::File => Err(no_recipe()),
    }
}

/// The controls of the recipe's values.
fn controls(work: &Work) -> Result<Reply, Refused> {
    Ok(Reply::json(&recipe_of(work)?.controls()))
}

/// The changed recipe as text.
fn recipe(work: &Work) -> Result<Reply, Refused> {
    let text = recipe_of(work)?.with(&work.state().edit);
    Ok(Reply::text(200, &text))
}

/// Takes changes of the page, as JSON, and begins to compute them.
fn set(work: &Work, sent: &str) -> Result<Reply, Refused> {
    let edit = recipe_of(work)?.edit(sent)?;
    work.change(edit);
    Ok(Reply::json(&work.describe()))
}

/// Values over a slice that the page requests, in binary.
fn slice(work: &Work, sent: &str) -> Result<Reply, Refused> {
    let sampled = work.state().sampled.as_ref().map(Arc::clone);
    let sampled = sampled.ok_or_else(|| Refused::new("found no level set to slice"))?;
    Ok(Reply::bytes(sampled.slice(sent)?))
}

/// Starts the full run of the changed recipe on a thread of its own, unless one is in progress, which is refused.
fn run<'scope, 'a: 'scope>(
    work: &'scope Work<'a>,
    scope: &'scope Scope<'scope, '_>,
) -> Result<Reply, Refused> {
    let Subject::Recipe(recipe) = &work.subject else {
        return Err(no_recipe());
    };
    // One lock for test and mark: two requests cannot both start a run.
    let edit = {
        let mut state = work.state();
        if state.full["running"] == true {
            return Err(Refused::new(
                "found a full run in progress; expected its end",
            ));
        }
        state.full = json!({ "running": true });
        state.edit.clone()
    };
    let number = work.full.next();
    let started =
        Builder::new().spawn_scoped(scope, move || levels::run_full(work, recipe, &edit, number));
    if started.is_err() {
        work.state().full = json!({ "running": false });
        return Err(Refused::new("found no memory for another thread"));
    }
    Ok(Reply::json(&work.describe()))
}
