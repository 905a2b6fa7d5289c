//! A slicer's list of triangles that are not part of the solid.
//!
//! `PrusaSlicer` writes parts, modifiers and negative volumes of an object as one mesh, with a separate list
//! of their triangles.

use quick_xml::events::{BytesStart, Event};
use quick_xml::{Reader, XmlVersion};
use std::collections::BTreeMap;
use std::io::BufRead;

/// The name of the list in the archive.
pub(super) const LIST_NAME: &str = "Metadata/Slic3r_PE_model.config";

/// Triangles of an object that are not solid.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Volume {
    /// The first and the last of the triangles.
    pub triangles: [usize; 2],
    /// Their type: `NegativeVolume`, `ParameterModifier` and others.
    pub kind: String,
}

/// The text of an attribute, if it can be read.
fn attribute(e: &BytesStart, name: &str) -> Option<String> {
    let own = e.try_get_attribute(name).ok()??;
    Some(
        own.normalized_value(XmlVersion::Implicit1_0)
            .ok()?
            .into_owned(),
    )
}

/// The non-solid volumes of each object, by its number. Reading stops at invalid XML: the list is an extra of the
/// slicer.
pub(super) fn non_solid_volumes(list: impl BufRead) -> BTreeMap<u32, Vec<Volume>> {
    let mut found: BTreeMap<u32, Vec<Volume>> = BTreeMap::new();
    let mut reader = Reader::from_reader(list);
    let mut buffer = Vec::new();
    let (mut object, mut volume): (Option<u32>, Option<Volume>) = (None, None);
    loop {
        buffer.clear();
        let Ok(event) = reader.read_event_into(&mut buffer) else {
            return found;
        };
        match event {
            Event::Start(e) | Event::Empty(e) => match e.local_name().as_ref() {
                b"object" => object = attribute(&e, "id").and_then(|v| v.parse().ok()),
                b"volume" => {
                    let end = |name| attribute(&e, name).and_then(|v| v.parse().ok());
                    volume = end("firstid")
                        .zip(end("lastid"))
                        .map(|(first, last)| Volume {
                            triangles: [first, last],
                            kind: String::new(),
                        });
                }
                b"metadata" => {
                    let key = attribute(&e, "key").unwrap_or_default();
                    let text = attribute(&e, "value").unwrap_or_default();
                    // Current versions have a type, older ones a mark of modifiers. A model part is solid and
                    // needs no entry.
                    if let Some(volume) = &mut volume {
                        match key.as_str() {
                            "volume_type" if text != "ModelPart" => volume.kind = text,
                            "modifier" if text == "1" && volume.kind.is_empty() => {
                                "ParameterModifier".clone_into(&mut volume.kind);
                            }
                            _ => {}
                        }
                    }
                }
                _ => {}
            },
            Event::End(e) if e.local_name().as_ref() == b"volume" => {
                if let Some((volume, id)) = volume.take().zip(object)
                    && !volume.kind.is_empty()
                {
                    found.entry(id).or_default().push(volume);
                }
            }
            Event::Eof => return found,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn modifiers_and_negative_volumes_are_distinguished_from_parts() {
        let list = "<config><object id=\"3\"><metadata type=\"object\" key=\"name\" value=\"a\"/>\
            <volume firstid=\"0\" lastid=\"11\"><metadata type=\"volume\" key=\"volume_type\" value=\"ModelPart\"/></volume>\
            <volume firstid=\"12\" lastid=\"23\"><metadata type=\"volume\" key=\"modifier\" value=\"1\"/>\
            <metadata type=\"volume\" key=\"volume_type\" value=\"NegativeVolume\"/></volume>\
            <volume firstid=\"24\" lastid=\"35\"><metadata type=\"volume\" key=\"modifier\" value=\"1\"/></volume>\
            </object></config>";
        let found = non_solid_volumes(list.as_bytes());
        let kinds: Vec<(&str, [usize; 2])> = found[&3]
            .iter()
            .map(|v| (v.kind.as_str(), v.triangles))
            .collect();
        assert_eq!(
            kinds,
            [
                ("NegativeVolume", [12, 23]),
                ("ParameterModifier", [24, 35])
            ]
        );
        assert!(non_solid_volumes(&b"not xml <"[..]).is_empty());
    }
}
