//! The number types of binary files and their decoding: the names that VTK's two forms and PLY give them.
//! Bytes are decoded in the order that the caller gives. Integers of 64 bits may lose digits as real numbers.

/// A number type.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    I64,
    U64,
    F32,
    F64,
}

// Unknown names are `None`; the caller reports them with their place.
impl Scalar {
    /// The type of a name in an XML file.
    pub fn from_xml(name: &str) -> Option<Self> {
        Some(match name {
            "Int8" => Self::I8,
            "UInt8" => Self::U8,
            "Int16" => Self::I16,
            "UInt16" => Self::U16,
            "Int32" => Self::I32,
            "UInt32" => Self::U32,
            "Int64" => Self::I64,
            "UInt64" => Self::U64,
            "Float32" => Self::F32,
            "Float64" => Self::F64,
            _ => return None,
        })
    }

    /// The type of a name in a legacy file.
    pub fn from_legacy(name: &str) -> Option<Self> {
        Some(match name.to_ascii_lowercase().as_str() {
            "char" | "signed_char" => Self::I8,
            "unsigned_char" => Self::U8,
            "short" => Self::I16,
            "unsigned_short" => Self::U16,
            "int" | "vtkidtype" => Self::I32,
            "unsigned_int" => Self::U32,
            "long" | "vtktypeint64" | "long_long" => Self::I64,
            "unsigned_long" | "vtktypeuint64" | "unsigned_long_long" => Self::U64,
            "float" => Self::F32,
            "double" => Self::F64,
            _ => return None,
        })
    }

    /// The type of a name in the header of a PLY file.
    pub fn from_ply(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "int64" | "long" => Self::I64,
            "uint64" | "ulong" => Self::U64,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// The size of a number in bytes.
    pub fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::I64 | Self::U64 | Self::F64 => 8,
        }
    }

    /// Whether it is a floating-point type.
    pub fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// A number from its first `size` bytes.
    pub fn real(self, bytes: &[u8], big_endian: bool) -> f64 {
        match self {
            Self::F32 => f64::from(f32::from_bits(self.bits(bytes, big_endian) as u32)),
            Self::F64 => f64::from_bits(self.bits(bytes, big_endian)),
            Self::U64 => self.bits(bytes, big_endian) as f64,
            _ => self.whole(bytes, big_endian) as f64,
        }
    }

    /// An integer from its first `size` bytes; values beyond 63 bits become -1, which is invalid as a count,
    /// and floats lose their fraction.
    pub fn whole(self, bytes: &[u8], big_endian: bool) -> i64 {
        let bits = self.bits(bytes, big_endian);
        match self {
            Self::I8 => i64::from(bits as u8 as i8),
            Self::I16 => i64::from(bits as u16 as i16),
            Self::I32 => i64::from(bits as u32 as i32),
            Self::I64 => bits as i64,
            Self::U8 | Self::U16 | Self::U32 | Self::U64 => i64::try_from(bits).unwrap_or(-1),
            Self::F32 | Self::F64 => self.real(bytes, big_endian) as i64,
        }
    }

    /// The first `size` bytes as one number, in the given order of bytes.
    fn bits(self, bytes: &[u8], big_endian: bool) -> u64 {
        let own = &bytes[..self.size()];
        let join = |bits: u64, b: &u8| bits << 8 | u64::from(*b);
        if big_endian {
            own.iter().fold(0, join)
        } else {
            own.iter().rev().fold(0, join)
        }
    }
}
