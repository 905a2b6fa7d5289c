//! Frames of a sequence: lists of frames, frame tokens in file names, and the clock.
//!
//! A token is a place in a file name that holds the frame: `$F4`, `####` and `%04d` hold four digits, `$F` and
//! `%d` as many as the frame has. The clock follows Houdini: `time = (frame - 1) / fps`, so that frame 1 is at 0.
//! Not promised: a list does not know files; [`frames_on_disk`] finds the frames that have one.
//!
//! ```
//! use druse::sequence::{Clock, FrameList, expand};
//! let frames: FrameList = "1-9x4,20".parse().unwrap();
//! assert_eq!(frames.frames(), [1, 5, 9, 20]);
//! assert_eq!(expand("bar.$F4.vdb", 12).unwrap().as_deref(), Some("bar.0012.vdb"));
//! assert_eq!(Clock { frame: 25, fps: 24.0 }.time(), 1.0);
//! ```

mod list;
mod token;

pub use list::{FrameList, FrameListError};
pub use token::{TokenError, expand, frames_on_disk, has_token, nearest_frames, without_token};

/// A frame and the rate of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Clock {
    /// Number of the frame.
    pub frame: i32,
    /// Frames per second; positive.
    pub fps: f64,
}

impl Clock {
    /// Seconds since frame 1: `(frame - 1) / fps`.
    pub fn time(self) -> f64 {
        (f64::from(self.frame) - 1.0) / self.fps
    }

    /// The names that formulas may use, and their values at this frame.
    pub fn constants(self) -> [(&'static str, f64); 3] {
        [
            ("frame", f64::from(self.frame)),
            ("time", self.time()),
            ("fps", self.fps),
        ]
    }
}
