//! Numbers as the terminal shows and reads them: counts and sizes of memory. Sizes are powers of 1024 in both
//! directions.

/// A count with separated thousands.
pub(super) fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (place, digit) in digits.chars().enumerate() {
        if place > 0 && (digits.len() - place).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

/// Bytes as text; K, M, G are powers of 1024.
pub(super) fn size(bytes: u64) -> String {
    let mut value = bytes as f64;
    for unit in ["B", "KiB", "MiB"] {
        if value < 1024.0 {
            return if unit == "B" {
                format!("{bytes} B")
            } else {
                format!("{value:.1} {unit}")
            };
        }
        value /= 1024.0;
    }
    format!("{value:.1} GiB")
}

/// Parses "2G", "512M", "1073741824".
pub(super) fn memory(text: &str) -> Result<u64, String> {
    let upper = text.trim().to_ascii_uppercase();
    let number = upper.trim_end_matches(|c: char| c.is_ascii_alphabetic());
    let power = match upper[number.len()..]
        .trim_end_matches("IB")
        .trim_end_matches('B')
    {
        "" => 0,
        "K" => 1,
        "M" => 2,
        "G" => 3,
        "T" => 4,
        // An unknown unit, which the filter below refuses.
        _ => 5,
    };
    let value: Option<f64> = number.trim().parse().ok().filter(|v| *v > 0.0 && power < 5);
    value
        .map(|v| (v * 1024f64.powi(power)) as u64)
        .ok_or_else(|| format!("found {text:?}, expected a size such as 512M or 2G"))
}
