//! Values that are written in one of several forms: a flag, a number, a text, a list or a table. A type implements
//! `Forms` for those that it takes, and the macro `forms!` makes it readable and describes it in the schema.

use schemars::{Schema, SchemaGenerator};
use serde::de::{DeserializeOwned, Error, MapAccess, SeqAccess, Unexpected, Visitor};
use std::fmt;
use std::marker::PhantomData;

/// A type with several written forms. Those that it lacks are refused.
pub(super) trait Forms: Sized {
    /// The forms, for errors.
    const DESCRIPTION: &'static str;

    /// All forms as a schema.
    fn schema(generator: &mut SchemaGenerator) -> Schema;

    /// Reads `true` or `false`; the methods below read the other forms.
    fn flag<E: Error>(v: bool) -> Result<Self, E> {
        Err(refused(Unexpected::Bool(v), Self::DESCRIPTION))
    }
    fn number<E: Error>(v: f64) -> Result<Self, E> {
        let found = format!("the number {v}");
        Err(refused(Unexpected::Other(&found), Self::DESCRIPTION))
    }
    fn text<E: Error>(v: &str) -> Result<Self, E> {
        Err(refused(Unexpected::Str(v), Self::DESCRIPTION))
    }
    fn list<'de, A: SeqAccess<'de>>(_: A) -> Result<Self, A::Error> {
        Err(refused(Unexpected::Seq, Self::DESCRIPTION))
    }
    fn table<'de, A: MapAccess<'de>>(_: A) -> Result<Self, A::Error> {
        Err(refused(Unexpected::Map, Self::DESCRIPTION))
    }
}

/// The error for a form that a type lacks.
fn refused<E: Error>(found: Unexpected<'_>, expected: &str) -> E {
    E::invalid_type(found, &expected)
}

/// Reads a value in whichever form it has.
pub(super) struct FormVisitor<T>(pub PhantomData<T>);

impl<'de, T: Forms> Visitor<'de> for FormVisitor<T> {
    type Value = T;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(T::DESCRIPTION)
    }
    fn visit_bool<E: Error>(self, v: bool) -> Result<T, E> {
        T::flag(v)
    }
    fn visit_f64<E: Error>(self, v: f64) -> Result<T, E> {
        T::number(v)
    }
    fn visit_i64<E: Error>(self, v: i64) -> Result<T, E> {
        T::number(v as f64)
    }
    fn visit_u64<E: Error>(self, v: u64) -> Result<T, E> {
        T::number(v as f64)
    }
    fn visit_str<E: Error>(self, v: &str) -> Result<T, E> {
        T::text(v)
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<T, A::Error> {
        T::list(seq)
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
        T::table(map)
    }
}

/// Reads a value of the command line as TOML. One of letters, digits and `_` alone is a string, also a number.
pub(super) fn from_argument<T: DeserializeOwned>(s: &str) -> Result<T, String> {
    let is_bare = s.chars().all(|c| c.is_ascii_alphanumeric() || c == '_');
    let text = if is_bare {
        format!("{s:?}")
    } else {
        s.to_owned()
    };
    let value = toml::de::ValueDeserializer::parse(&text);
    let read = value.and_then(T::deserialize);
    read.map_err(|e| e.message().to_owned())
}

/// Lets types be read and described by their forms, under a name in the schema.
macro_rules! forms {
    ($type:ty, $name:expr) => {
        impl<'de> serde::Deserialize<'de> for $type {
            fn deserialize<D: serde::Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
                d.deserialize_any(super::forms::FormVisitor(std::marker::PhantomData))
            }
        }
        impl schemars::JsonSchema for $type {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                $name.into()
            }
            fn json_schema(generator: &mut schemars::SchemaGenerator) -> schemars::Schema {
                <Self as super::forms::Forms>::schema(generator)
            }
        }
    };
}
pub(super) use forms;
