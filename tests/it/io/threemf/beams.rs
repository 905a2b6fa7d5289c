//! Beam lattices of 3MF: reported files, files of lib3mf, attributes and their defaults.

use super::{document, model, refused, stored};
use druse::io::{BeamCap, is_strut_file, read_mesh, read_skeleton, read_solid};

const BEAMS: &str = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/2017/02";

#[test]
fn beams_of_reported_files_are_read_or_named() {
    let both = read_solid(stored("beams_and_mesh.3mf")).unwrap();
    assert!((both.file.mesh.volume() - 1000.0).abs() < 1e-9);
    assert_eq!(
        both.file.mesh.vertices().len(),
        8,
        "a node of beams alone is no vertex"
    );
    assert_eq!(both.beams.len(), 1);
    assert_eq!(both.beams[0].len(), 2);
    assert!(both.beams[0].beams.iter().all(|b| b.radii == [1.0, 1.0]));
    let bounds = both.bounds();
    assert_eq!(<[f64; 3]>::from(bounds.max), [31.0, 11.0, 11.0]);
    // The second beam ends at (10, 0, 0).
    assert_eq!(<[f64; 3]>::from(bounds.min), [0.0, -1.0, -1.0]);
    for name in ["beams_and_mesh.3mf", "beams_only.3mf"] {
        let error = read_mesh(stored(name)).unwrap_err();
        assert!(
            error.to_string().contains("a beam lattice of 2 beams"),
            "{error}"
        );
        assert!(error.hint().unwrap().contains("voxelize"));
    }
    let only = read_solid(stored("beams_only.3mf")).unwrap();
    assert!(only.file.mesh.is_empty() && only.beams[0].len() == 2);
    assert!(is_strut_file(stored("beams_only.3mf")).unwrap());
    assert!(!is_strut_file(stored("beams_and_mesh.3mf")).unwrap());
    let error = read_solid(stored("unknown_extension.3mf"))
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("requires an unknown extension (http://example.com/q)"),
        "{error}"
    );
    let graph = read_skeleton(stored("t14b_beams_only_notri.3mf"), None, None).unwrap();
    assert_eq!(graph.struts().len(), 12);
    assert!(
        graph
            .struts()
            .iter()
            .all(|s| s.1 == 1.0 && (s.0[1] - s.0[0]).norm() == 10.0)
    );
}

#[test]
fn beams_of_lib3mf_have_their_caps_clips_and_balls() {
    use BeamCap::{Butt, Hemisphere, Sphere};
    let caps = read_solid(stored("caps.3mf")).unwrap();
    let found: Vec<_> = caps.beams[0]
        .beams
        .iter()
        .map(|b| (b.caps, b.radii))
        .collect();
    assert_eq!(
        found,
        [
            ([Butt, Butt], [1.0, 1.0]),
            ([Hemisphere, Hemisphere], [1.0, 1.0]),
            ([Sphere, Butt], [1.0, 1.0]),
            ([Butt, Butt], [2.0, 1.0]),
        ]
    );
    // Flat ends add nothing along the axis; the cone is widest at its first end.
    let bounds = caps.bounds();
    assert_eq!((bounds.min.x, bounds.max.x), (-1.0, 11.0));
    assert_eq!((bounds.min.y, bounds.max.y), (-1.0, 32.0));
    let clipped = read_solid(stored("clipped.3mf")).unwrap();
    let clip = clipped.beams[0].clip.as_ref().unwrap();
    assert!(clip.keeps_inside && (clip.mesh.volume() - 1000.0).abs() < 1e-9);
    assert!(
        clipped.file.mesh.is_empty(),
        "the clipping mesh is not built"
    );
    assert_eq!(clipped.bounds().max.x, 10.0);
    // Mirrored, twice as large and moved by one, in centimetres.
    let balls = read_solid(stored("balls.3mf")).unwrap();
    let part = &balls.beams[0];
    assert_eq!(balls.file.unit.unwrap().symbol(), "cm");
    assert_eq!(part.balls.len(), 1);
    assert_eq!(
        (<[f64; 3]>::from(part.balls[0].0), part.balls[0].1),
        ([-3.0, 0.0, 0.0], 1.0)
    );
    assert!((part.beams[0].radii[0] - 0.2).abs() < 1e-12);
    assert_eq!(<[f64; 3]>::from(part.beams[0].ends[0]), [1.0, 0.0, 0.0]);
}

/// A lattice of one beam along x from 0 to 4 with these attributes.
fn lattice(attributes: &str, beam: &str, rest: &str) -> String {
    let b2 = "http://schemas.microsoft.com/3dmanufacturing/beamlattice/balls/2020/07";
    let mesh = format!(
        "<object id=\"1\"><mesh><vertices><vertex x=\"0\" y=\"0\" z=\"0\"/><vertex x=\"4\" y=\"0\" z=\"0\"/>\
         <vertex x=\"0\" y=\"3\" z=\"0\"/></vertices><q:beamlattice {attributes}><q:beams>{beam}</q:beams>{rest}\
         </q:beamlattice></mesh></object>"
    );
    let spaces = format!("xmlns:q=\"{BEAMS}\" xmlns:b2=\"{b2}\" requiredextensions=\"q\"");
    document(&spaces, &mesh, "<item objectid=\"1\"/>")
}

#[test]
fn attributes_of_beams_have_their_defaults() {
    let read = |attributes: &str, beam: &str, rest: &str| {
        let solid = model(&lattice(attributes, beam, rest)).unwrap();
        (solid.beams, solid.file.warnings)
    };
    let (beams, _) = read(
        "radius=\"2\" minlength=\"0.1\"",
        "<q:beam v1=\"0\" v2=\"1\" r1=\"1\"/>",
        "",
    );
    assert_eq!(beams[0].beams[0].radii, [1.0, 1.0]);
    assert_eq!(beams[0].beams[0].caps, [BeamCap::Sphere; 2]);
    let ends = "<q:beam v1=\"0\" v2=\"1\" cap2=\"butt\"/>";
    let (beams, _) = read(
        "radius=\"2\" cap=\"hemisphere\" precision=\"0.1\"",
        ends,
        "",
    );
    assert_eq!(beams[0].beams[0].radii, [2.0, 2.0]);
    assert_eq!(beams[0].beams[0].caps, [BeamCap::Hemisphere, BeamCap::Butt]);
    // Beams that are shorter than the least length do not count.
    let two = "<q:beam v1=\"0\" v2=\"1\"/><q:beam v1=\"0\" v2=\"2\"/>";
    let (beams, notes) = read("radius=\"1\" minlength=\"3.5\"", two, "");
    assert_eq!(beams[0].len(), 1);
    assert_eq!(notes, ["1 beam shorter than minlength left out"]);
    // Balls: none without a mode, those listed, those at all ends.
    let list = "<b2:balls><b2:ball vindex=\"1\"/><b2:ball vindex=\"2\" r=\"1.5\"/></b2:balls>";
    let beam = "<q:beam v1=\"0\" v2=\"1\"/>";
    let balls = |mode: &str| {
        let attributes = format!("radius=\"0.5\" minlength=\"0.1\" {mode}");
        let (beams, _) = read(&attributes, beam, list);
        let radii: Vec<f64> = beams[0].balls.iter().map(|b| b.1).collect();
        radii
    };
    assert!(balls("").is_empty());
    assert_eq!(balls("ballmode=\"mixed\" ballradius=\"1\""), [1.0, 1.5]);
    assert_eq!(
        balls("b2:ballmode=\"all\" b2:ballradius=\"1\""),
        [1.0, 1.0, 1.5]
    );
    for (attributes, beam, word) in [
        (
            "minlength=\"0.1\"",
            "<q:beam v1=\"0\" v2=\"1\"/>",
            "a beam without a radius",
        ),
        (
            "radius=\"1\"",
            "<q:beam v1=\"0\" v2=\"7\"/>",
            "beam 1 with vertex 7",
        ),
        (
            "radius=\"-1\"",
            "<q:beam v1=\"0\" v2=\"1\"/>",
            "radius=\"-1\"",
        ),
        ("radius=\"1\" cap=\"round\"", "", "cap=\"round\""),
        (
            "radius=\"1\" clippingmode=\"inside\" clippingmesh=\"9\"",
            "<q:beam v1=\"0\" v2=\"1\"/>",
            "clipped by a mesh",
        ),
        (
            "radius=\"1\" ballmode=\"all\"",
            "<q:beam v1=\"0\" v2=\"1\"/>",
            "without ballradius",
        ),
    ] {
        refused(&lattice(attributes, beam, ""), &[word]);
    }
    let sheared = lattice("radius=\"1\"", beam, "").replace(
        "<item objectid=\"1\"/>",
        "<item objectid=\"1\" transform=\"2 0 0 0 1 0 0 0 1 0 0 0\"/>",
    );
    refused(
        &sheared,
        &["object 1: a beam lattice under a transform that shears or stretches"],
    );
}

/// The first drafts of the extension name the mode of clipping "clipping", and the least length "precision".
#[test]
fn clipping_has_its_older_name_too() {
    let clip = |attribute: &str| {
        let beam = "<q:beam v1=\"0\" v2=\"1\"/>";
        let text = lattice(
            &format!("radius=\"1\" precision=\"0.1\" clippingmesh=\"2\" {attribute}"),
            beam,
            "",
        );
        let mesh = format!(
            "<object id=\"2\">{}</object><object id=\"1\">",
            super::cube(0.0)
        );
        let solid = model(&text.replacen("<object id=\"1\">", &mesh, 1)).unwrap();
        solid.beams[0].clip.as_ref().map(|c| c.keeps_inside)
    };
    for name in ["clipping", "clippingmode"] {
        assert_eq!(clip(&format!("{name}=\"inside\"")), Some(true));
        assert_eq!(clip(&format!("{name}=\"outside\"")), Some(false));
        assert_eq!(clip(&format!("{name}=\"none\"")), None);
    }
    assert_eq!(clip("clippingmode=\"none\" clipping=\"inside\""), None);
}

#[test]
fn numbers_beyond_the_limit_are_refused() {
    let beam = "<q:beam v1=\"0\" v2=\"1\"/>";
    for x in ["1e18", "1e308", "inf", "nan"] {
        refused(
            &lattice(&format!("radius=\"{x}\""), beam, ""),
            &["radius", "1e18", "byte"],
        );
        let far = lattice("radius=\"1\"", beam, "").replace("x=\"4\"", &format!("x=\"{x}\""));
        refused(&far, &["coordinate", "1e18", "byte"]);
        let moved = super::one("", &format!("transform=\"1 0 0 0 1 0 0 0 1 {x} 0 0\""));
        refused(&moved, &["transform", "1e18", "byte"]);
    }
    // Each number is in range, their product is not.
    let scaled = "transform=\"1e10 0 0 0 1e10 0 0 0 1e10 0 0 0\"";
    let far = lattice("radius=\"1\"", beam, "").replace("x=\"4\"", "x=\"1e10\"");
    refused(
        &far.replace("objectid=\"1\"", &format!("objectid=\"1\" {scaled}")),
        &["beam 1", "1e18"],
    );
}
