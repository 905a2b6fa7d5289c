//! Ten kinds of damage to a file, by dice that fall alike on every machine.

/// A small generator of numbers, the same on every machine.
pub struct Dice(pub u64);

impl Dice {
    pub fn below(&mut self, n: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6364136223846793005)
            .wrapping_add(1442695040888963407);
        ((self.0 >> 33) as usize) % n.max(1)
    }

    pub fn of<'a, T>(&mut self, list: &'a [T]) -> &'a T {
        &list[self.below(list.len())]
    }
}

const NUMBERS: [&str; 12] = [
    "nan",
    "inf",
    "-1",
    "0",
    "1e999",
    "-1e-999",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "99999999999999999999999",
    "0x10",
    "",
];
const GARBAGE: [&[u8]; 6] = [
    b"\0\0\0\0",
    b"\xff\xff\xff\xff",
    b"\n\n\n",
    b"<a b='",
    b"-",
    b"\xc3\x28 garbage ",
];

/// One of ten kinds of damage, by the dice; `other` is a good file to splice from.
pub fn damage(bytes: &mut Vec<u8>, other: &[u8], dice: &mut Dice) {
    let length = bytes.len();
    let at = dice.below(length);
    match dice.below(10) {
        0 => bytes.truncate(at),
        1 => bytes[at] ^= 1 << dice.below(8),
        2 => {
            for _ in 0..=dice.below(16) {
                let at = dice.below(length);
                bytes[at] = dice.below(256) as u8;
            }
        }
        3 => lines(bytes, dice, |lines, i, _| drop(lines.remove(i))),
        4 => lines(bytes, dice, |lines, i, _| lines.insert(i, lines[i].clone())),
        5 => lines(bytes, dice, |lines, i, j| lines.swap(i, j)),
        6 => number(bytes, dice),
        7 => {
            let garbage = *dice.of(&GARBAGE);
            bytes.splice(at..at, garbage.iter().copied());
        }
        8 => {
            // A word of four or eight bytes replaced by an extreme one.
            let word = *dice.of(&[
                [0u8; 8],
                [0xff; 8],
                [0xff, 0xff, 0xff, 0x7f, 0, 0, 0, 0],
                [0, 0, 0, 0x80, 0, 0, 0, 0x80],
            ]);
            let end = (at + *dice.of(&[4, 8])).min(length);
            bytes[at..end].copy_from_slice(&word[..end - at]);
        }
        _ => {
            let from = dice.below(other.len());
            let end = (from + dice.below(64)).min(other.len());
            bytes.splice(at..at, other[from..end].iter().copied());
        }
    }
}

fn lines(bytes: &mut Vec<u8>, dice: &mut Dice, change: impl Fn(&mut Vec<Vec<u8>>, usize, usize)) {
    let mut lines: Vec<Vec<u8>> = bytes
        .split_inclusive(|&b| b == b'\n')
        .map(<[u8]>::to_vec)
        .collect();
    let (i, j) = (dice.below(lines.len()), dice.below(lines.len()));
    change(&mut lines, i, j);
    *bytes = lines.concat();
}

/// Replaces a number of a text by a strange one.
fn number(bytes: &mut Vec<u8>, dice: &mut Dice) {
    let is_part = |b: u8| b.is_ascii_digit() || b == b'.' || b == b'-';
    let starts: Vec<usize> = (0..bytes.len())
        .filter(|&i| is_part(bytes[i]) && (i == 0 || !is_part(bytes[i - 1])))
        .collect();
    if starts.is_empty() {
        return;
    }
    // Often one of the first: counts stand in headers.
    let near = dice.below(2) == 0;
    let start = starts[dice.below(if near {
        starts.len().min(12)
    } else {
        starts.len()
    })];
    let end = (start..bytes.len())
        .find(|&i| !is_part(bytes[i]))
        .unwrap_or(bytes.len());
    bytes.splice(start..end, dice.of(&NUMBERS).bytes());
}
