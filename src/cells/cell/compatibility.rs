//! Which groups and lattices are compatible with which element.
//!
//! | element | groups | lattices |
//! |---|---|---|
//! | tri | D3, C1 | hex2 |
//! | quad | D4, C1 | square |
//! | tet | Td, T, C3v, C1 | fcc2, cubic |
//! | hex | Oh, O, T, Th, Td, D4h, D2h, C4v, C3v, C1 | cubic |
//! | wedge | D3h, C3v, C1 | hexprism |
//! | pyramid | C4v, C1 | fcc1, tetragonal |
//! | ball | Ih | icosahedral |
//!
//! The first group (the full one) and the first lattice are the defaults. The ball fills no scaffold:
//! the icosahedral group has no lattice in space, so its cell is a single isolated solid.

use super::{CellError, Expression};
use crate::symmetry::{GROUP_NAMES, GroupText, Lattice, PointGroup, SpaceGroup};
use druse_geometry::frame::{Element, Mat3};
use nalgebra::SMatrix;

/// Each element with its named symmetry groups and its lattices; the first of each is the default.
const ELEMENT_SYMMETRIES: [(Element, &[&str], &[&str]); 7] = [
    (Element::Tri, &["D3", "C1"], &["hex2"]),
    (Element::Quad, &["D4", "C1"], &["square"]),
    (Element::Tet, &["Td", "T", "C3v", "C1"], &["fcc2", "cubic"]),
    (
        Element::Hex,
        &["Oh", "O", "T", "Th", "Td", "D4h", "D2h", "C4v", "C3v", "C1"],
        &["cubic"],
    ),
    (Element::Wedge, &["D3h", "C3v", "C1"], &["hexprism"]),
    (Element::Pyramid, &["C4v", "C1"], &["fcc1", "tetragonal"]),
    (Element::Ball, &["Ih"], &["icosahedral"]),
];

/// Dimension of an element's lattices: the element's own, or 6 for the ball (icosahedral module).
pub const fn rank(element: Element) -> usize {
    match element {
        Element::Ball => 6,
        _ => element.dimension(),
    }
}

/// The default group. It makes a cell independent of the numbering of an element's nodes.
/// It is the full symmetry group of the element.
pub fn default_group(element: Element) -> &'static str {
    groups(element)[0]
}

/// The names of the groups of an element; the first is the default. Any other group that maps the
/// element and the lattice onto themselves is accepted too ([`symmetry`]).
pub fn groups(element: Element) -> &'static [&'static str] {
    ELEMENT_SYMMETRIES[element as usize].1
}

/// The names of the lattices of an element; the first is the default.
pub fn lattices(element: Element) -> &'static [&'static str] {
    ELEMENT_SYMMETRIES[element as usize].2
}

/// The group and the lattice of the given names for an element of dimension `D`; `None` selects the
/// default. A group without a name is given by its generators, one per line or separated by `;`, in
/// the syntax of [`GroupText`]: "-x,-y,z; x,-y,-z".
///
/// # Errors
/// [`CellError::Unfitting`] for a group or lattice of another element or dimension,
/// [`CellError::Symmetry`] for an unknown group, [`CellError::GroupText`] for invalid generators.
pub fn symmetry<const D: usize>(
    element: Element,
    group: Option<&str>,
    lattice: Option<&str>,
) -> Result<(PointGroup<D>, Lattice<D>), CellError> {
    let parsed = match group {
        // A text with commas lists operators. With fractions too it is a space group, which `space_group` parses below.
        Some(text) if text.contains(',') && !text.contains('/') => {
            Some(GroupText::parse(&text.replace(';', "\n"))?)
        }
        _ => None,
    };
    // The lattice of the caller comes before the one in the text; without both, it is the first of the element.
    let text_lattice = parsed.as_ref().and_then(|t| t.lattice.clone());
    let name = lattice
        .or(text_lattice.as_deref())
        .unwrap_or(lattices(element)[0]);
    if rank(element) != D {
        return Err(unfitting(
            element,
            "dimension",
            D.to_string(),
            rank(element).to_string(),
        ));
    }
    if !lattices(element).contains(&name) {
        let expected = lattices(element).join(" or ");
        return Err(unfitting(element, "lattice", name.to_owned(), expected));
    }
    let lattice = Lattice::named(name)?;
    // A cell with a space group is fitted as one of the site group about the origin; translations are applied
    // to the series afterwards.
    if let Some(space) = space_group::<D>(element, group)? {
        return Ok((space.site_group()?, lattice));
    }
    let group = match parsed {
        None => PointGroup::named(group.unwrap_or(default_group(element)), &lattice)?,
        Some(text) => {
            // The operators are given on the coordinates of the text's lattice and apply on the chosen one
            // after a change of basis.
            let (group, home) = text.group("own", name)?;
            group.on_lattice(&home, &lattice)?
        }
    };
    check_group(element, group.name(), &embedded(&group, &lattice))?;
    Ok((group, lattice))
}

/// The space group of a name such as `I4132`, or of operators with fractions; `None` for a point group. The operators
/// of the result are on the first lattice of the element.
///
/// # Errors
/// [`CellError::Unfitting`] for an element that is no hex, or a group that does not map the cube onto itself;
/// [`CellError::Symmetry`] for invalid operators.
pub fn space_group<const D: usize>(
    element: Element,
    group: Option<&str>,
) -> Result<Option<SpaceGroup<D>>, CellError> {
    let Some(text) = group.filter(|t| !GROUP_NAMES.contains(t)) else {
        return Ok(None);
    };
    let space = if text.contains(',') && text.contains('/') {
        SpaceGroup::generated(text)?
    } else {
        match SpaceGroup::<D>::named(text) {
            Some(space) => space,
            None => return Ok(None),
        }
    };
    // Its periods are those of the element, which only a hex repeats.
    if element != Element::Hex {
        let expected = format!(
            "{}; groups with fractions are for hexes",
            groups(element).join(", ")
        );
        return Err(unfitting(element, "group", text.to_owned(), expected));
    }
    let lattice = Lattice::named(lattices(element)[0])?;
    check_group(element, text, &embedded(&space.point_group()?, &lattice))?;
    Ok(Some(space))
}

/// The error that names what was `found` and what is `expected`: a lattice, a group or a dimension.
fn unfitting(element: Element, what: &'static str, found: String, expected: String) -> CellError {
    CellError::Unfitting {
        element: element.name(),
        what,
        found,
        expected,
    }
}

/// Checks that a group keeps the element.
/// `operators` are the group's, in Cartesian reference coordinates; `name` is for the error.
fn check_group(element: Element, name: &str, operators: &[Mat3]) -> Result<(), CellError> {
    // The ball requires the full group: its series are summed as even in x, y and z.
    let whole = element != Element::Ball || operators.len() == element.symmetry_order();
    if whole && operators.iter().all(|q| element.is_invariant_under(q)) {
        return Ok(());
    }
    if element == Element::Ball {
        return Err(unfitting(
            element,
            "group",
            name.to_owned(),
            "Ih".to_owned(),
        ));
    }
    let expected = format!(
        "{}, or another group of symmetries of the {}",
        groups(element).join(", "),
        element.name()
    );
    Err(unfitting(element, "group", name.to_owned(), expected))
}

/// The Cartesian operators of a group as maps of space. Planar operators leave z unchanged. Of operators
/// with internal coordinates, the block that acts on space is used.
/// They are in Cartesian reference coordinates, in the order of the group.
pub(super) fn embedded<const D: usize>(group: &PointGroup<D>, lattice: &Lattice<D>) -> Vec<Mat3> {
    let in_space = |q: &SMatrix<f64, D, D>| {
        Mat3::from_fn(|i, j| match (i < D, j < D) {
            (true, true) => q[(i, j)],
            _ => f64::from(u8::from(i == j)),
        })
    };
    group.cartesian(lattice).iter().map(in_space).collect()
}

/// Whether the list holds the operator `q`, up to rounding.
/// The limit is 1e-6 for the root of the sum of the squared differences of entries.
fn contains(list: &[Mat3], q: &Mat3) -> bool {
    list.iter().any(|p| (p - q).norm_squared() < 1e-12)
}

/// Name and Cartesian operators of the group that all series of an element's function share. Each
/// series must fit the element.
/// An error for a series of another dimension, group or lattice, and for an expression without a series. A common
/// subgroup without a name is called "common".
pub(super) fn symmetry_of(
    element: Element,
    expression: &Expression,
) -> Result<(String, Vec<Mat3>), CellError> {
    let mut found: Option<(String, Vec<Mat3>)> = None;
    for leaf in expression.leaves() {
        if leaf.dimension() != rank(element) {
            return Err(unfitting(
                element,
                "dimension",
                leaf.dimension().to_string(),
                rank(element).to_string(),
            ));
        }
        let operators = leaf.operators();
        check_group(element, leaf.group_name(), &operators)?;
        let lattice = leaf.lattice_name();
        if !lattice.is_some_and(|n| lattices(element).contains(&n)) {
            let expected = lattices(element).join(" or ");
            return Err(unfitting(element, "lattice", leaf.lattice_text(), expected));
        }
        // The common operators of all series so far, with the name of the last series whose whole group they were; the
        // name may denote a larger group and is checked below.
        found = Some(match found.take() {
            None => (leaf.group_name().to_owned(), operators),
            Some((name, mut common)) => {
                common.retain(|q| contains(&operators, q));
                let name = if common.len() == operators.len() {
                    leaf.group_name().to_owned()
                } else {
                    name
                };
                (name, common)
            }
        });
    }
    let (name, operators) =
        found.ok_or_else(|| CellError::Expression("it holds no series".to_owned()))?;
    // Keep the name only if it denotes exactly these operators, not a larger group.
    let order = expression
        .leaves()
        .iter()
        .find(|l| l.group_name() == name)
        .map(|l| l.operators().len());
    if order == Some(operators.len()) {
        return Ok((name, operators));
    }
    let named = groups(element).iter().find(|g| {
        operators_of(element, g).is_ok_and(|known| {
            known.len() == operators.len() && known.iter().all(|q| contains(&operators, q))
        })
    });
    Ok((named.map_or("common", |n| n).to_owned(), operators))
}

/// The Cartesian operators of a named group of an element. Those of a planar element leave z unchanged.
///
/// # Errors
/// As [`symmetry`].
pub fn operators_of(element: Element, group: &str) -> Result<Vec<Mat3>, CellError> {
    fn of<const D: usize>(element: Element, group: &str) -> Result<Vec<Mat3>, CellError> {
        let (group, lattice) = symmetry::<D>(element, Some(group), None)?;
        Ok(embedded(&group, &lattice))
    }
    match rank(element) {
        2 => of::<2>(element, group),
        3 => of::<3>(element, group),
        _ => of::<6>(element, group),
    }
}
