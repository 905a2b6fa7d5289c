//! The writer of 3MF with an implicit part: the function of a cell as a graph of nodes, and the closed mesh in which
//! it is evaluated (volumetric and implicit extensions, version 1).
//!
//! Coordinates of the mesh are in the unit of the file. The function takes a position in that unit and returns a length
//! in it, negative in the solid.

use super::package::begin;
use druse_cells::cell::{Expression, Node};
use druse_geometry::frame::{LengthUnit, Vec3};
use druse_geometry::mesh::TriMesh;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::io::{self, Seek, Write};

/// Attributes of a model with an implicit part.
const EXTENSION_ATTRIBUTES: &str = " xmlns:v=\"http://schemas.3mf.io/3dmanufacturing/volumetric/2022/01\" \
                                    xmlns:i=\"http://schemas.3mf.io/3dmanufacturing/implicit/2023/12\" \
                                    requiredextensions=\"v i\"";

/// A function repeated in space inside a closed mesh.
pub struct ImplicitPart<'a> {
    /// The name of the function.
    pub name: &'a str,
    /// The function in reference coordinates: negative in the solid, its slope on the surface about 1.
    pub function: &'a Expression,
    /// Edge of the reference cell, in `unit`; the cell's centre is the origin.
    pub edge: f64,
    /// Closed mesh with outward triangles, in `unit`.
    pub domain: &'a TriMesh,
    /// Whether the domain is an axis-aligned box.
    pub is_box: bool,
    /// Translation of the part on the build plate, in `unit`.
    pub offset: Vec3,
    /// The unit of the file.
    pub unit: LengthUnit,
}

impl ImplicitPart<'_> {
    /// Writes the part as an archive; returns the number of nodes of its function.
    ///
    /// # Errors
    /// Those of the file.
    pub fn write(&self, out: impl Write + Seek) -> io::Result<usize> {
        let mut graph = Graph {
            xml: String::new(),
            nodes: 0,
            per_edge: 1.0 / self.edge,
        };
        // The function is in reference units; its value times the edge is a length in the model.
        let value = graph.expression(self.function);
        let scale = graph.constant(self.edge);
        let value = graph.pair("multiplication", &value, &scale);

        // An entry of 4 GiB needs the long form of ZIP; half of that is left for the mesh.
        let is_large = graph.xml.len() > u32::MAX as usize / 2;
        let mut xml = begin(out, is_large)?;
        write!(
            xml,
            "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<model unit=\"{}\" xml:lang=\"en-US\" \
             xmlns=\"http://schemas.microsoft.com/3dmanufacturing/core/2015/02\"{EXTENSION_ATTRIBUTES}>\n\
             <metadata name=\"Application\">druse {}</metadata>\n\
             <resources>\n<object id=\"1\" type=\"model\"><mesh>\n<vertices>\n",
            self.unit.name_3mf(),
            env!("CARGO_PKG_VERSION"),
        )?;
        for v in self.domain.vertices() {
            writeln!(
                xml,
                "<vertex x=\"{:?}\" y=\"{:?}\" z=\"{:?}\"/>",
                v.x, v.y, v.z
            )?;
        }
        writeln!(xml, "</vertices>\n<triangles>")?;
        for [a, b, c] in self.domain.triangles() {
            writeln!(xml, "<triangle v1=\"{a}\" v2=\"{b}\" v3=\"{c}\"/>")?;
        }
        // A quarter of the shortest wave, or of the edge if waves are longer, is the finest feature to be resolved.
        let finest = 0.25 * self.edge / self.function.band_limit().max(1.0);
        let [x, y, z] = [self.offset.x, self.offset.y, self.offset.z];
        write!(
            xml,
            "</triangles>\n</mesh></object>\n<i:implicitfunction id=\"2\" displayname=\"{}\">\n\
             <i:in><i:vector identifier=\"pos\" displayname=\"pos\"/></i:in>\n{}\
             <i:out><i:scalarref identifier=\"shape\" displayname=\"shape\" ref=\"{value}\"/></i:out>\n\
             </i:implicitfunction>\n<object id=\"3\" type=\"model\"><v:levelset functionid=\"2\" channel=\"shape\" \
             meshid=\"1\" meshbboxonly=\"{}\" minfeaturesize=\"{finest:?}\"/></object>\n</resources>\n\
             <build><item objectid=\"3\" transform=\"1 0 0 0 1 0 0 0 1 {x:?} {y:?} {z:?}\"/></build>\n</model>\n",
            quick_xml::escape::escape(self.name),
            graph.xml,
            self.is_box,
        )?;
        xml.flush()?;
        let zip = xml.into_inner();
        zip.map_err(io::IntoInnerError::into_error)?.finish()?;
        Ok(graph.nodes)
    }
}

/// The nodes of a function, written in the order of evaluation.
struct Graph {
    xml: String,
    nodes: usize,
    /// Reference lengths per unit of length.
    per_edge: f64,
}

/// A reference to the output of a node, as `node.output`.
type Output = String;

impl Graph {
    /// Begins a node; `n12` is the name of the twelfth.
    fn begin(&mut self, kind: &str, attributes: &str) -> String {
        self.nodes += 1;
        let name = format!("n{}", self.nodes);
        let _ = write!(
            self.xml,
            "<i:{kind} identifier=\"{name}\" displayname=\"{name}\"{attributes}>"
        );
        name
    }

    /// A constant number.
    fn constant(&mut self, value: f64) -> Output {
        let name = self.begin("constant", &format!(" value=\"{value:?}\""));
        self.xml +=
            "<i:out><i:scalar identifier=\"value\" displayname=\"value\"/></i:out></i:constant>\n";
        format!("{name}.value")
    }

    /// A constant vector.
    fn vector(&mut self, v: Vec3) -> Output {
        let attributes = format!(" x=\"{:?}\" y=\"{:?}\" z=\"{:?}\"", v.x, v.y, v.z);
        let name = self.begin("constvec", &attributes);
        self.xml += "<i:out><i:vector identifier=\"vector\" displayname=\"vector\"/></i:out></i:constvec>\n";
        format!("{name}.vector")
    }

    /// A node with the inputs A, B, ... of a type (scalar or vector) and a scalar result.
    fn node(&mut self, kind: &str, input: &str, values: &[&str]) -> Output {
        let name = self.begin(kind, "");
        self.xml += "<i:in>";
        for (letter, value) in ["A", "B"].iter().zip(values) {
            let _ = write!(
                self.xml,
                "<i:{input}ref identifier=\"{letter}\" displayname=\"{letter}\" ref=\"{value}\"/>"
            );
        }
        let _ = writeln!(
            self.xml,
            "</i:in><i:out><i:scalar identifier=\"result\" displayname=\"result\"/></i:out></i:{kind}>"
        );
        format!("{name}.result")
    }

    /// A node with one scalar input.
    fn single(&mut self, kind: &str, a: &str) -> Output {
        self.node(kind, "scalar", &[a])
    }

    /// A node with two scalar inputs.
    fn pair(&mut self, kind: &str, a: &str, b: &str) -> Output {
        self.node(kind, "scalar", &[a, b])
    }

    /// A value times a constant.
    fn times(&mut self, factor: f64, value: &str) -> Output {
        let factor = self.constant(factor);
        self.pair("multiplication", &factor, value)
    }

    /// Combines values from the first to the last; 0 without values.
    fn fold(
        &mut self,
        values: Vec<Output>,
        mut join: impl FnMut(&mut Self, &str, &str) -> Output,
    ) -> Output {
        let joined = values.into_iter().reduce(|a, b| join(self, &a, &b));
        joined.unwrap_or_else(|| self.constant(0.0))
    }

    fn sum(&mut self, values: Vec<Output>) -> Output {
        self.fold(values, |graph, a, b| graph.pair("addition", a, b))
    }

    /// Adds the nodes of an expression in reference units and returns their result.
    fn expression(&mut self, expression: &Expression) -> Output {
        match expression.node() {
            // Series of all dimensions are sums of waves with frequencies in space: planar ones do not vary
            // along z, icosahedral ones are restricted to internal coordinates 0.
            Node::Series(s) => {
                let waves = s
                    .exponentials()
                    .iter()
                    .map(|&(k, c)| (s.lattice().frequency(k), c));
                self.series(waves)
            }
            Node::Planar(s) => {
                let waves = s.exponentials().iter().map(|&(k, c)| {
                    let f = s.lattice().frequency(k);
                    (Vec3::new(f.x, f.y, 0.0), c)
                });
                self.series(waves)
            }
            Node::Icosahedral(s) => {
                let s = s.series();
                let waves = s.exponentials().iter().map(|&(k, c)| {
                    let f = s.lattice().frequency(k);
                    (f.fixed_rows::<3>(0).into_owned(), c)
                });
                self.series(waves)
            }
            Node::Sum(parts) => {
                let values = parts.iter().map(|(weight, part)| {
                    let value = self.expression(part);
                    self.times(*weight, &value)
                });
                let values = values.collect();
                self.sum(values)
            }
            Node::Min(parts, radius) => self.extreme("min", parts, *radius),
            Node::Max(parts, radius) => self.extreme("max", parts, *radius),
            Node::Magnitude(part) => {
                let value = self.expression(part);
                self.single("abs", &value)
            }
            Node::Shift(part, by) => {
                let value = self.expression(part);
                let by = self.constant(*by);
                self.pair("subtraction", &value, &by)
            }
            Node::Negation(part) => {
                let value = self.expression(part);
                self.times(-1.0, &value)
            }
        }
    }

    /// A minimum ("min") or maximum ("max"), rounded where values are closer than the radius:
    /// min(a, b) - max(r - |a - b|, 0)^2 / (4 r). A maximum adds that term.
    fn extreme(&mut self, kind: &str, parts: &[Expression], radius: f64) -> Output {
        let values = parts.iter().map(|part| self.expression(part)).collect();
        self.fold(values, |graph, a, b| {
            let sharp = graph.pair(kind, a, b);
            if radius == 0.0 {
                return sharp;
            }
            let difference = graph.pair("subtraction", a, b);
            let distance = graph.single("abs", &difference);
            let constant = graph.constant(radius);
            let closeness = graph.pair("subtraction", &constant, &distance);
            let zero = graph.constant(0.0);
            let positive = graph.pair("max", &closeness, &zero);
            let square = graph.pair("multiplication", &positive, &positive);
            let correction = graph.times(0.25 / radius, &square);
            let sign = if kind == "min" {
                "subtraction"
            } else {
                "addition"
            };
            graph.pair(sign, &sharp, &correction)
        })
    }

    /// The sum over frequencies f (cycles per reference length) of C exp(2 pi i f.x), whose opposites are all among
    /// them. Each pair is one cosine; cosines of equal amplitude are added before they are multiplied by it.
    fn series(&mut self, waves: impl Iterator<Item = (Vec3, [f64; 2])>) -> Output {
        let mut mean = 0.0;
        let mut groups: Vec<(f64, Vec<Output>)> = Vec::new();
        for (f, [re, im]) in waves {
            if f == Vec3::zeros() {
                mean += re;
                continue;
            }
            // Of f and -f the one whose first coordinate that is not 0 is positive stands for both.
            let first = f.iter().find(|c| **c != 0.0);
            if first.is_none_or(|c| *c < 0.0) || (re, im) == (0.0, 0.0) {
                continue;
            }
            let wave_vector = self.vector(f * (TAU * self.per_edge));
            let mut phase = self.node("dot", "vector", &["inputs.pos", &wave_vector]);
            // C exp(i t) and its conjugate add up to 2 |C| cos(t + arg C), or 2 re cos t.
            let amplitude = if im == 0.0 {
                2.0 * re
            } else {
                let shift = self.constant(libm::atan2(im, re));
                phase = self.pair("addition", &phase, &shift);
                2.0 * libm::hypot(re, im)
            };
            let cosine = self.single("cos", &phase);
            match groups
                .iter_mut()
                .find(|g| g.0.to_bits() == amplitude.to_bits())
            {
                Some((_, cosines)) => cosines.push(cosine),
                None => groups.push((amplitude, vec![cosine])),
            }
        }
        let mut values = Vec::with_capacity(groups.len() + 1);
        for (amplitude, cosines) in groups {
            let sum = self.sum(cosines);
            values.push(self.times(amplitude, &sum));
        }
        if mean != 0.0 {
            values.push(self.constant(mean));
        }
        self.sum(values)
    }
}
