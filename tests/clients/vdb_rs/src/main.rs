//! What the crate vdb-rs reads of a grid of floats: active voxels, and the sum of their values.
fn main() {
    let path = std::env::args().nth(1).expect("a .vdb");
    let file = std::io::BufReader::new(std::fs::File::open(path).expect("the file"));
    let mut reader = vdb_rs::VdbReader::new(file).expect("a .vdb");
    println!("grids {:?}", reader.available_grids());
    let grid = reader.read_grid::<f32>("surface").expect("the grid surface");
    let (mut count, mut sum) = (0u64, 0f64);
    for (_, value, _) in grid.iter() {
        count += 1;
        sum += f64::from(value);
    }
    println!("surface {count} voxels, sum {sum}");
}
