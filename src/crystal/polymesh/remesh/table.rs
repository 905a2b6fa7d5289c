//! The table of remeshing schemes: names, parameters with their ranges, classes of new faces, growth, and the rule.
//!
//! A new scheme is one more row here and a function in `corner.rs`, `edge.rs`, `face.rs` or `dome.rs`.

use super::{Old, OpenRange, Parameter, RuleResult, corner, dome, edge, face};

/// A row of the table: one scheme.
pub(super) struct Row {
    pub name: &'static str,
    pub aliases: &'static [&'static str],
    pub parameters: &'static [Parameter],
    /// Names of the classes of new faces.
    pub classes: &'static [&'static str],
    /// Maximum number of new corners per old corner; the size of a result is checked by it before the rule runs.
    pub growth: u64,
    /// Whether the result has exactly so many corners for all meshes without vertices of degree 2.
    pub is_exact: bool,
    /// Makes the new mesh of the old one and the values of the parameters, in the order of `parameters`.
    pub rule: fn(&Old, &[f64]) -> RuleResult,
}

const fn between(above: f64, below: f64) -> OpenRange {
    OpenRange { above, below }
}

const fn parameter(
    name: &'static str,
    default: f64,
    range: OpenRange,
    meaning: &'static str,
) -> Parameter {
    Parameter {
        name,
        default,
        range,
        meaning,
    }
}

/// Range of unrestricted parameters.
const UNRESTRICTED_RANGE: OpenRange = between(-1e6, 1e6);
const ALL_CLASSES: &[&str] = &["all"];
const VERTEX_CLASSES: &[&str] = &["face", "vertex"];
const CORNER_CLASSES: &[&str] = &["face", "corner"];
const EDGE_CLASSES: &[&str] = &["face", "edge", "vertex"];

#[rustfmt::skip]
pub(super) const TABLE: [Row; 30] = [
    Row { name: "dual", aliases: &[], parameters: &[], classes: ALL_CLASSES, growth: 1, is_exact: true, rule: face::dual },
    Row { name: "root3", aliases: &[], classes: ALL_CLASSES, growth: 3, is_exact: true, rule: face::root3,
        parameters: &[parameter("smooth", 0.0, between(-1.0, 2.0), "1 moves old vertices by Kobbelt's rule")] },
    Row { name: "triangulate", aliases: &[], parameters: &[], classes: ALL_CLASSES, growth: 3, is_exact: false, rule: face::triangulate },
    Row { name: "stellate", aliases: &["global_stellate"], classes: ALL_CLASSES, growth: 3, is_exact: true, rule: face::stellate,
        parameters: &[parameter("height", 0.0, UNRESTRICTED_RANGE, "of the centres, in mean edges of the face")] },
    Row { name: "double_stellate_star", aliases: &["star"], classes: ALL_CLASSES, growth: 9, is_exact: true, rule: face::star,
        parameters: &[parameter("height", 0.0, UNRESTRICTED_RANGE, "of the first centres, in mean edges of the face")] },
    Row { name: "double_stellate_misc", aliases: &[], classes: ALL_CLASSES, growth: 6, is_exact: true, rule: face::double_stellate,
        parameters: &[parameter("height", 0.0, UNRESTRICTED_RANGE, "of the first centres, in mean edges of the face")] },
    Row { name: "stellate_edge_removal", aliases: &["stellate_with_edge_removal"], classes: ALL_CLASSES, growth: 2, is_exact: true, rule: face::edge_removal,
        parameters: &[parameter("height", 0.0, UNRESTRICTED_RANGE, "of the centres, in mean edges of the face")] },
    Row { name: "linear_vertex_insertion", aliases: &["linear_vertex"], parameters: &[], classes: ALL_CLASSES, growth: 4, is_exact: true, rule: face::linear },
    Row { name: "catmull_clark", aliases: &[], parameters: &[], classes: ALL_CLASSES, growth: 4, is_exact: true, rule: face::catmull_clark },
    Row { name: "pentagonal", aliases: &["pentagonalization"], classes: ALL_CLASSES, growth: 5, is_exact: true, rule: face::pentagonal,
        parameters: &[parameter("offset", 0.0, between(-1.0, 1.0), "moves the first third of a half-edge towards the face's centre")] },
    Row { name: "cubic_pentagonal", aliases: &["cubic_pentagonalization"], classes: ALL_CLASSES, growth: 5, is_exact: true, rule: face::cubic_pentagonal,
        parameters: &[parameter("offset", 0.0, between(-1.0, 1.0), "as for pentagonal")] },
    Row { name: "fractal", aliases: &[], classes: CORNER_CLASSES, growth: 6, is_exact: true, rule: face::fractal,
        parameters: &[parameter("offset", 1.0, UNRESTRICTED_RANGE, "height of the pyramids")] },
    Row { name: "simplest", aliases: &["ambo"], parameters: &[], classes: VERTEX_CLASSES, growth: 2, is_exact: true, rule: edge::simplest },
    Row { name: "vertex_truncation", aliases: &[], classes: VERTEX_CLASSES, growth: 3, is_exact: true, rule: edge::vertex_truncation,
        parameters: &[parameter("offset", 0.25, between(0.0, 0.5), "share of an edge that is cut off; at 1/2 it would be simplest")] },
    Row { name: "honeycomb", aliases: &[], parameters: &[], classes: VERTEX_CLASSES, growth: 3, is_exact: true, rule: edge::honeycomb },
    Row { name: "loop_style", aliases: &[], classes: CORNER_CLASSES, growth: 4, is_exact: true, rule: edge::loop_style,
        parameters: &[parameter("length", 1.0, UNRESTRICTED_RANGE, "1 keeps old vertices, 0 moves them to the mean of the middles around")] },
    Row { name: "loop", aliases: &[], parameters: &[], classes: CORNER_CLASSES, growth: 4, is_exact: true, rule: edge::loop_smooth },
    Row { name: "checkerboard", aliases: &[], classes: &["face", "rest"], growth: 9, is_exact: true, rule: edge::checkerboard,
        parameters: &[parameter("t", 0.33, between(0.0, 0.5), "where the points of an edge stand, from its ends")] },
    Row { name: "pentagon_preserving", aliases: &[], classes: CORNER_CLASSES, growth: 6, is_exact: true, rule: edge::pentagon_preserving,
        parameters: &[parameter("scale", 0.75, between(0.0, 1.0), "of the inner polygon against that of the middles")] },
    Row { name: "doo_sabin", aliases: &[], parameters: &[], classes: EDGE_CLASSES, growth: 4, is_exact: true, rule: corner::doo_sabin },
    Row { name: "corner_cutting", aliases: &[], classes: EDGE_CLASSES, growth: 4, is_exact: true, rule: corner::corner_cutting,
        parameters: &[parameter("alpha", 0.5625, between(-1.0, 1.0), "own weight of a corner")] },
    Row { name: "modified_corner_cutting", aliases: &[], classes: EDGE_CLASSES, growth: 4, is_exact: true, rule: corner::modified_corner_cutting,
        parameters: &[parameter("thickness", 0.25, UNRESTRICTED_RANGE, "twice the distance by which edges move inward, in the model's unit")] },
    Row { name: "root4", aliases: &["hexagon_preserving"], classes: &["face", "edge"], growth: 4, is_exact: true, rule: corner::root4,
        parameters: &[parameter("tension", 0.0, between(-1.0, 1.0), "0 takes a honeycomb's weight, 1 would put inner corners at the old ones"),
                      parameter("twist", 0.0, between(-1.0, 1.0), "moves the averaged points along the edges")] },
    Row { name: "dual_twelve_six_four", aliases: &["dual_12_6_4"], classes: EDGE_CLASSES, growth: 6, is_exact: true, rule: corner::dual_twelve_six_four,
        parameters: &[parameter("scale", 0.6, between(0.0, 1.0), "of a face's thirds about their mean")] },
    Row { name: "twelve_six_four", aliases: &["generic_12_6_4"], classes: ALL_CLASSES, growth: 6, is_exact: true, rule: corner::twelve_six_four,
        parameters: &[parameter("scale", 0.6, between(0.0, 1.0), "as for dual_twelve_six_four")] },
    Row { name: "doo_sabin_bc", aliases: &[], parameters: &[], classes: EDGE_CLASSES, growth: 7, is_exact: true, rule: corner::doo_sabin_bc },
    Row { name: "doo_sabin_bc_new", aliases: &[], parameters: &[], classes: &["face", "edge"], growth: 7, is_exact: true, rule: corner::doo_sabin_bc_new },
    Row { name: "global_cubic_extrude", aliases: &["loft"], classes: &["top", "side"], growth: 5, is_exact: true, rule: corner::loft,
        parameters: &[parameter("scale", 0.5, between(0.0, 1e6), "of the inner face about the centre"),
                      parameter("height", 0.0, UNRESTRICTED_RANGE, "of the inner face, in mean edges of the face")] },
    Row { name: "dome", aliases: &[], classes: &["cap", "rest"], growth: 116, is_exact: true, rule: dome::dome,
        parameters: &[parameter("height", 1.0, UNRESTRICTED_RANGE, "factor on the rings' heights"),
                      parameter("scale", 1.0, between(0.0, 10.0), "factor on the rings' scales")] },
    Row { name: "root3_smooth", aliases: &["kobbelt"], parameters: &[], classes: ALL_CLASSES, growth: 3, is_exact: true, rule: |old, _| face::root3(old, &[1.0]) },
];
