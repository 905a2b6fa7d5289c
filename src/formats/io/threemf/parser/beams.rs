//! The XML elements of beam lattices. Attributes that a beam or ball leaves out have the value of the lattice, but `r2`
//! that of `r1`. Lengths are in the unit of the model.

use super::Parser;
use crate::io::beam_parts::BeamCap;
use crate::io::error::ReadError;
use crate::io::source::quote;
use crate::io::threemf::display_name;
use crate::io::threemf::extensions::Space;
use crate::io::threemf::lattice::{BallMode, ClipMode, Lattice, Strut};
use druse_geometry::frame::is_in_range;
use quick_xml::events::BytesStart;
use std::io::BufRead;

impl<R: BufRead> Parser<'_, R> {
    /// An optional cap.
    fn cap(&self, e: &BytesStart, name: &str) -> Result<Option<BeamCap>, ReadError> {
        use BeamCap::{Butt, Hemisphere, Sphere};
        let known = [
            ("sphere", Sphere),
            ("hemisphere", Hemisphere),
            ("butt", Butt),
        ];
        self.keyword(e, name, &known)
    }

    /// An optional radius, more than 0.
    fn radius(&self, e: &BytesStart, name: &str) -> Result<Option<f64>, ReadError> {
        let found = self.length(e, name)?;
        if found == Some(0.0) {
            return Err(self.bad(format!("{name}=\"0\""), "a radius more than 0"));
        }
        Ok(found)
    }

    /// The lattice of the current object; an error outside lattices.
    fn lattice(&mut self, e: &BytesStart) -> Result<&mut Lattice, ReadError> {
        let is_open = self
            .object
            .as_ref()
            .is_some_and(|(_, o)| o.lattice.is_some());
        if !is_open {
            let element = String::from_utf8_lossy(e.name().as_ref()).into_owned();
            let found = format!("<{}> outside a beam lattice", display_name(&element));
            return Err(self.bad(found, "a <beamlattice> around it"));
        }
        let object = self.object(e)?;
        Ok(object.lattice.get_or_insert_default())
    }

    /// Begins an element of the beam lattice extension, `local` its name; returns whether its content is read.
    pub(super) fn start_beams(&mut self, e: &BytesStart, local: &[u8]) -> Result<bool, ReadError> {
        match local {
            b"beamlattice" => {
                let clips = [
                    ("none", ClipMode::None),
                    ("inside", ClipMode::Inside),
                    ("outside", ClipMode::Outside),
                ];
                let balls = [
                    ("none", BallMode::None),
                    ("mixed", BallMode::Mixed),
                    ("all", BallMode::All),
                ];
                // Older files name the least length "precision", and the mode of clipping "clipping".
                let min_length = match self.length(e, "minlength")? {
                    None => self.length(e, "precision")?,
                    found => found,
                };
                let clip = match self.keyword(e, "clippingmode", &clips)? {
                    None => self.keyword(e, "clipping", &clips)?,
                    found => found,
                };
                let lattice = Lattice {
                    min_length: min_length.unwrap_or(0.0),
                    // 0 stands for a missing radius, which each beam then has to state.
                    radius: self.radius(e, "radius")?.unwrap_or(0.0),
                    cap: self.cap(e, "cap")?.unwrap_or_default(),
                    clip: clip.unwrap_or_default(),
                    clip_mesh: self.optional(e, "clippingmesh")?,
                    representation_mesh: self.optional(e, "representationmesh")?,
                    ball_mode: match self.keyword(e, "ballmode", &balls)? {
                        Some(mode) => mode,
                        None => self.ball_mode(e, &balls)?,
                    },
                    ball_radius: match self.radius(e, "ballradius")? {
                        None => self.ball_radius(e)?,
                        found => found,
                    },
                    ..Lattice::default()
                };
                let object = self.object(e)?;
                if object.lattice.is_some() {
                    return Err(self.bad("a second beam lattice in an object", "one"));
                }
                object.lattice = Some(lattice);
            }
            b"beam" => {
                let ends = [self.number(e, "v1")?, self.number(e, "v2")?];
                let radii = [self.radius(e, "r1")?, self.radius(e, "r2")?];
                let caps = [self.cap(e, "cap1")?, self.cap(e, "cap2")?];
                let lattice = self.lattice(e)?;
                let first = radii[0].unwrap_or(lattice.radius);
                let beam = Strut {
                    ends,
                    radii: [first, radii[1].unwrap_or(first)],
                    caps: caps.map(|c| c.unwrap_or(lattice.cap)),
                };
                if beam.radii.contains(&0.0) {
                    let expected = "the attribute r1, or radius of the beam lattice";
                    return Err(self.bad("a beam without a radius", expected));
                }
                lattice.beams.push(beam);
            }
            b"ball" => {
                let ball = (self.number(e, "vindex")?, self.radius(e, "r")?);
                self.lattice(e)?.balls.push(ball);
            }
            // Sets of beams do not affect the shape.
            b"beamsets" => return Ok(false),
            _ => {}
        }
        Ok(true)
    }

    /// The mode of balls with the prefix of the balls extension.
    fn ball_mode(&self, e: &BytesStart, known: &[(&str, BallMode)]) -> Result<BallMode, ReadError> {
        let Some(text) = self.attribute_in(e, Space::Beams, "ballmode")? else {
            return Ok(BallMode::None);
        };
        let found = known.iter().find(|k| k.0 == text.trim()).map(|k| k.1);
        found.ok_or_else(|| self.bad(format!("ballmode={}", quote(&text)), "none, mixed, all"))
    }

    /// The radius of the balls of a lattice, if it states one.
    fn ball_radius(&self, e: &BytesStart) -> Result<Option<f64>, ReadError> {
        let Some(text) = self.attribute_in(e, Space::Beams, "ballradius")? else {
            return Ok(None);
        };
        let radius = text
            .trim()
            .parse()
            .ok()
            .filter(|r| is_in_range(*r) && *r > 0.0);
        let bad = || {
            self.bad(
                format!("ballradius={}", quote(&text)),
                "a radius more than 0",
            )
        };
        radius.map(Some).ok_or_else(bad)
    }
}
