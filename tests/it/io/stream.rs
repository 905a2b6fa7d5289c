//! Mesh files that come part by part.

use super::ball;
use druse::frame::LengthUnit;
use druse::io::{Faces, MeshPart, MeshStream, MeshView, VertexAttribute, WriteError, write_mesh};
use druse::mesh::{QuadMesh, TriMesh};
use std::fs;

#[test]
fn a_mesh_that_comes_in_parts_is_written_as_one_that_comes_whole() {
    let mesh = ball();
    let (half, all) = (mesh.vertices().len() / 2, mesh.vertices());
    let is_first = |t: &&[u32; 3]| t.iter().all(|&v| (v as usize) < half);
    let first: Vec<[u32; 3]> = mesh.triangles().iter().filter(is_first).copied().collect();
    let rest = mesh.triangles().iter().filter(|t| !is_first(t));
    let second: Vec<[u32; 3]> = rest.copied().collect();
    // The second part has its own vertices first, then those of the first again.
    let own = all.len() - half;
    let places = [&all[half..], &all[..half]].concat();
    let local = |v: u32| (v as usize + own) % all.len();
    let local: Vec<[u32; 3]> = second.iter().map(|t| t.map(|v| local(v) as u32)).collect();
    let whole = TriMesh::new(all.to_vec(), [&first[..], &second[..]].concat()).unwrap();
    let directory = tempfile::tempdir().unwrap();
    for name in ["m.stl", "m.ply", "m.obj", "m.3mf"] {
        let path = directory.path().join(name);
        let is_ply = name == "m.ply";
        let names = ["a", "b"].map(str::to_owned);
        let names = if is_ply { names.to_vec() } else { Vec::new() };
        let row = names.len();
        let mut stream = MeshStream::create(&path, LengthUnit::Inch, false, names.clone()).unwrap();
        let parts = [
            (&all[..half], half, &first, &first),
            (&places[..], own, &local, &second),
        ];
        let numbers: Vec<f32> = (0..row * all.len()).map(|n| n as f32).collect();
        let mut rest = &numbers[..];
        for (vertices, owned, triangles, numbered) in parts {
            let factor = 0.7;
            let (numbers, after) = rest.split_at(row * owned);
            rest = after;
            let part = MeshPart {
                numbers,
                vertices,
                owned,
                faces: Faces::Triangles(triangles),
                numbered: Faces::Triangles(numbered),
                factor,
            };
            stream.add(part).unwrap();
        }
        assert!(!path.exists());
        let size = stream.commit().unwrap();
        let streamed = fs::read(&path).unwrap();
        assert_eq!(size, streamed.len() as u64);
        let attributes = [VertexAttribute {
            names,
            values: numbers,
        }];
        let view = druse::io::MeshView::from(&whole)
            .scaled(0.7)
            .with_attributes(if is_ply { &attributes } else { &[] });
        write_mesh(&path, view, LengthUnit::Inch).unwrap();
        assert!(fs::read(&path).unwrap() == streamed, "{name}");
    }
    let listed = fs::read_dir(directory.path()).unwrap().count();
    assert_eq!(listed, 4, "spools are left");
    for (name, has_quads, numbers) in [("m.png", false, 0), ("m.stl", false, 1), ("m.3mf", true, 0)]
    {
        let path = directory.path().join(name);
        let wrong = MeshStream::create(
            &path,
            LengthUnit::Inch,
            has_quads,
            vec!["a".into(); numbers],
        );
        assert!(matches!(wrong, Err(WriteError::Format { .. })), "{name}");
    }
}

#[test]
fn quads_and_triangles_come_in_parts_too() {
    let places = [[0, 0], [1, 0], [2, 0], [2, 1], [1, 1], [0, 1]];
    let at = |[x, y]: [i32; 2]| druse::frame::Vec3::new(x.into(), y.into(), 0.25);
    let vertices: Vec<_> = places.map(at).into();
    let faces = [[0, 1, 4, 5], [1, 2, 3, 3], [1, 3, 4, 4]];
    let whole = QuadMesh::new(vertices.clone(), faces.to_vec()).unwrap();
    let directory = tempfile::tempdir().unwrap();
    for name in ["q.ply", "q.obj"] {
        let path = directory.path().join(name);
        let mut stream = MeshStream::create(&path, LengthUnit::Metre, true, Vec::new()).unwrap();
        let parts = [
            (&vertices[..], 6, &whole.quads()[..1]),
            (&vertices[..], 0, &whole.quads()[1..]),
        ];
        for (vertices, owned, faces) in parts {
            let part = MeshPart {
                vertices,
                owned,
                faces: Faces::Quads(faces),
                numbered: Faces::Quads(faces),
                numbers: &[],
                factor: 1.0,
            };
            stream.add(part).unwrap();
        }
        stream.commit().unwrap();
        let streamed = fs::read(&path).unwrap();
        write_mesh(&path, MeshView::from(&whole), LengthUnit::Metre).unwrap();
        assert!(fs::read(&path).unwrap() == streamed, "{name}");
    }
    let path = directory.path().join("t.ply");
    let mut stream = MeshStream::create(&path, LengthUnit::Metre, false, Vec::new()).unwrap();
    let quads = Faces::Quads(whole.quads());
    let refused = stream.add(MeshPart {
        vertices: &vertices,
        owned: 6,
        faces: quads,
        numbered: quads,
        numbers: &[],
        factor: 1.0,
    });
    assert!(matches!(refused, Err(WriteError::Format { .. })));
}
