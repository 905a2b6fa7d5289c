//! Medit's keywords: codes in binary files (those of libMeshb) and meanings.
//!
//! A keyword that is not here is an error in text and skipped in binary files. Two names of one kind are those of
//! different programs.

use druse_tilings::scaffold::Kind;

/// The meaning of a keyword.
#[derive(Clone, Copy)]
pub(super) enum Meaning {
    Dimension,
    Vertices,
    /// Elements with their reference number.
    Element(Kind),
    /// Lines, which are counted as skipped.
    Lines,
    /// Numbers without effect on the shape.
    Ignored,
    /// Values that are ignored with a note.
    Values,
    /// Elements of unsupported kinds.
    Refused,
    /// A line of text.
    Text,
    End,
}

/// A keyword: its code in binary files (0: of text files only), its name, its meaning.
pub(super) type Row = (u32, &'static str, Meaning);

use Meaning::{Dimension, Element, End, Ignored, Lines, Refused, Text, Values, Vertices};

/// All keywords that are read, ignored or refused.
pub(super) const TABLE: &[Row] = &[
    (3, "Dimension", Dimension),
    (4, "Vertices", Vertices),
    (5, "Edges", Lines),
    (25, "EdgesP2", Lines),
    (92, "EdgesP3", Lines),
    (93, "EdgesP4", Lines),
    (6, "Triangles", Element(Kind::Tri3)),
    (7, "Quadrilaterals", Element(Kind::Quad4)),
    (8, "Tetrahedra", Element(Kind::Tet4)),
    (9, "Prisms", Element(Kind::Wedge6)),
    (0, "Pentahedra", Element(Kind::Wedge6)),
    (10, "Hexahedra", Element(Kind::Hex8)),
    (0, "Hexaedra", Element(Kind::Hex8)),
    (49, "Pyramids", Element(Kind::Pyramid5)),
    (24, "TrianglesP2", Element(Kind::Tri6)),
    (30, "TetrahedraP2", Element(Kind::Tet10)),
    (27, "QuadrilateralsQ2", Refused),
    (88, "QuadrilateralsQ3", Refused),
    (89, "QuadrilateralsQ4", Refused),
    (33, "HexahedraQ2", Refused),
    (98, "HexahedraQ3", Refused),
    (99, "HexahedraQ4", Refused),
    (86, "PrismsP2", Refused),
    (102, "PrismsP3", Refused),
    (103, "PrismsP4", Refused),
    (87, "PyramidsP2", Refused),
    (100, "PyramidsP3", Refused),
    (101, "PyramidsP4", Refused),
    (90, "TrianglesP3", Refused),
    (91, "TrianglesP4", Refused),
    (96, "TetrahedraP3", Refused),
    (97, "TetrahedraP4", Refused),
    (129, "TrianglesP2Ordering", Refused),
    (133, "TetrahedraP2Ordering", Refused),
    (46, "Polyhedra", Refused),
    (47, "Polygons", Refused),
    (13, "Corners", Ignored),
    (14, "Ridges", Ignored),
    (15, "RequiredVertices", Ignored),
    (16, "RequiredEdges", Ignored),
    (17, "RequiredTriangles", Ignored),
    (18, "RequiredQuadrilaterals", Ignored),
    (0, "RequiredTetrahedra", Ignored),
    (0, "RequiredHexahedra", Ignored),
    (0, "RequiredPrisms", Ignored),
    (0, "RequiredPyramids", Ignored),
    (0, "ParallelVertices", Ignored),
    (0, "ParallelEdges", Ignored),
    (0, "ParallelTriangles", Ignored),
    (0, "ParallelQuadrilaterals", Ignored),
    (19, "TangentAtEdgeVertices", Ignored),
    (0, "TangentAtEdges", Ignored),
    (20, "NormalAtVertices", Ignored),
    (21, "NormalAtTriangleVertices", Ignored),
    (22, "NormalAtQuadrilateralVertices", Ignored),
    (61, "TangentAtVertices", Ignored),
    (59, "Tangents", Ignored),
    (60, "Normals", Ignored),
    (23, "AngleOfCornerBound", Ignored),
    (50, "BoundingBox", Ignored),
    (77, "Iterations", Ignored),
    (78, "Time", Ignored),
    (40, "VertexOnGeometricVertex", Ignored),
    (41, "VertexOnGeometricEdge", Ignored),
    (42, "VertexOnGeometricTriangle", Ignored),
    (43, "VertexOnGeometricQuadrilateral", Ignored),
    (44, "EdgeOnGeometricEdge", Ignored),
    (0, "VerticesOnGeometricVertices", Ignored),
    (0, "VerticesOnGeometricEdges", Ignored),
    (0, "VerticesOnGeometricTriangles", Ignored),
    (0, "VerticesOnGeometricQuadrilaterals", Ignored),
    (0, "EdgesOnGeometricEdges", Ignored),
    (55, "TrianglesOnGeometricTriangles", Ignored),
    (56, "TrianglesOnGeometricQuadrilaterals", Ignored),
    (57, "QuadrilateralsOnGeometricTriangles", Ignored),
    (58, "QuadrilateralsOnGeometricQuadrilaterals", Ignored),
    (0, "SubDomain", Ignored),
    (29, "SubDomainFromGeom", Ignored),
    (0, "SubDomainFromMesh", Ignored),
    (82, "PeriodicVertices", Ignored),
    (83, "PeriodicEdges", Ignored),
    (84, "PeriodicTriangles", Ignored),
    (85, "PeriodicQuadrilaterals", Ignored),
    (62, "SolAtVertices", Values),
    (64, "SolAtTriangles", Values),
    (65, "SolAtQuadrilaterals", Values),
    (66, "SolAtTetrahedra", Values),
    (67, "SolAtPrisms", Values),
    (26, "SolAtPyramids", Values),
    (68, "SolAtHexahedra", Values),
    (0, "Geometry", Text),
    (0, "Identifier", Text),
    (54, "End", End),
];
