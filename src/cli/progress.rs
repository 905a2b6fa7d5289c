//! Progress on stderr: a bar, lines of text or JSON. Any thread may report; a stage replaces the one before.

use super::terminal;
use clap::ValueEnum;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::Write;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// How progress is shown.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Style {
    /// A moving bar.
    Bar,
    /// A line of text per stage and per tenth of it.
    Plain,
    /// A JSON object per line.
    Json,
    /// Nothing.
    None,
}

/// The current stage of the line styles; `shown` is the last tenth of it that was printed.
struct Stage {
    name: String,
    total: Option<u64>,
    done: u64,
    shown: u64,
    start: Instant,
}

/// Shows the stages of a run as they pass.
pub(super) struct Display {
    style: Style,
    bar: ProgressBar,
    stage: Mutex<Option<Stage>>,
}

impl Display {
    /// A display without a stage; a bar is drawn at most 8 times a second.
    pub(super) fn new(style: Style) -> Self {
        let bar = ProgressBar::with_draw_target(Some(0), ProgressDrawTarget::hidden());
        if style == Style::Bar {
            bar.set_draw_target(ProgressDrawTarget::stderr_with_hz(8));
        }
        Self {
            style,
            bar,
            stage: Mutex::new(None),
        }
    }

    /// Whether the style is a bar.
    pub(super) fn is_bar(&self) -> bool {
        self.style == Style::Bar
    }

    /// Begins a stage; `total` is the number of its steps, if it is known.
    pub(super) fn stage(&self, name: &str, total: Option<u64>) {
        let name = &*terminal::line(name);
        match self.style {
            Style::None => {}
            Style::Bar => {
                // Without a total there is no end to show, only the time so far.
                let template = if total.is_some() {
                    "{msg:<12} {wide_bar} {percent:>3} %  {eta:>4} left"
                } else {
                    "{msg:<12} {spinner} {elapsed}"
                };
                if let Ok(style) = ProgressStyle::with_template(template) {
                    self.bar.set_style(style);
                }
                self.bar.reset();
                self.bar.set_length(total.unwrap_or(0));
                self.bar.set_message(name.to_owned());
                self.bar.enable_steady_tick(Duration::from_millis(125));
            }
            Style::Plain | Style::Json => {
                let stage = Stage {
                    name: name.to_owned(),
                    total,
                    done: 0,
                    shown: 0,
                    start: Instant::now(),
                };
                self.print_line(&stage);
                if let Ok(mut current) = self.stage.lock() {
                    *current = Some(stage);
                }
            }
        }
    }

    /// Adds `n` steps to the current stage. The line styles print one line for each further tenth.
    pub(super) fn advance(&self, n: u64) {
        match self.style {
            Style::None => {}
            Style::Bar => self.bar.inc(n),
            Style::Plain | Style::Json => {
                let Ok(mut current) = self.stage.lock() else {
                    return;
                };
                if let Some(stage) = current.as_mut() {
                    stage.done += n;
                    let tenth = stage.total.map_or(0, |t| stage.done * 10 / t.max(1));
                    if tenth > stage.shown {
                        stage.shown = tenth;
                        self.print_line(stage);
                    }
                }
            }
        }
    }

    /// Prints the share and the time left of a stage, or only its name where the number of steps is unknown.
    fn print_line(&self, stage: &Stage) {
        let elapsed = stage.start.elapsed().as_secs_f64();
        let share = stage
            .total
            .map(|t| (stage.done as f64 / t.max(1) as f64).min(1.0));
        let left = share.filter(|&s| s > 0.0).map(|s| elapsed * (1.0 - s) / s);
        let line = if self.style == Style::Json {
            serde_json::json!({
                "stage": stage.name,
                "percent": share.map(|s| (s * 100.0).round()),
                "eta_seconds": left.map(|s| (s * 10.0).round() / 10.0),
            })
            .to_string()
        } else {
            let percent = share.map_or(String::new(), |s| format!(" {:.0} %", s * 100.0));
            let eta = left.map_or(String::new(), |s| format!(", {s:.0} s left"));
            format!("{}{percent}{eta}", stage.name)
        };
        let _ = writeln!(std::io::stderr(), "{line}");
    }

    /// A line on stderr that does not tear the bar.
    pub(super) fn line(&self, text: &str) {
        self.bar.suspend(|| {
            let _ = writeln!(std::io::stderr(), "{text}");
        });
    }

    /// Removes the bar.
    pub(super) fn finish(&self) {
        self.bar.disable_steady_tick();
        self.bar.finish_and_clear();
    }
}
