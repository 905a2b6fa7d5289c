//! Parameters whose first one may be written alone: `gaussian = 1` for `gaussian = { width = 1 }`. A table
//! implements `Short` by the macro `short!`; a key of the type `Brief` then takes both forms, in the schema too.

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{DeserializeOwned, Deserializer, IntoDeserializer, MapAccess, SeqAccess, Visitor};
use std::borrow::Cow;
use std::fmt;
use std::marker::PhantomData;
use std::ops::Deref;

/// A table of parameters that can be written as its first one alone.
pub trait Short {
    /// The first parameter: a number, a string, a flag or an array, never a table.
    type First: DeserializeOwned + JsonSchema;
    /// All parameters, the others at their defaults.
    fn short(first: Self::First) -> Self;
}

/// Lets a table be written as its first parameter alone; values of the others follow it.
macro_rules! short {
    ($table:ident { $first:ident: $type:ty $(, $key:ident: $value:expr)* $(, ..$others:expr)? }) => {
        impl super::brief::Short for $table {
            type First = $type;
            fn short($first: $type) -> Self {
                Self { $first $(, $key: $value)* $(, ..$others)? }
            }
        }
    };
}
pub(super) use short;

/// Reads `T` from its table or from its first parameter alone.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Brief<T>(pub T);

impl<T> Deref for Brief<T> {
    type Target = T;
    fn deref(&self) -> &T {
        &self.0
    }
}

impl<'de, T: Short + DeserializeOwned> Deserialize<'de> for Brief<T> {
    fn deserialize<D: Deserializer<'de>>(d: D) -> Result<Self, D::Error> {
        d.deserialize_any(BriefVisitor(PhantomData)).map(Brief)
    }
}

struct BriefVisitor<T>(PhantomData<T>);

impl<'de, T: Short + DeserializeOwned> Visitor<'de> for BriefVisitor<T> {
    type Value = T;

    // Part of errors on a value of no accepted kind.
    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a value or a table of parameters")
    }
    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<T, A::Error> {
        T::deserialize(MapAccessDeserializer::new(map))
    }
    fn visit_seq<A: SeqAccess<'de>>(self, seq: A) -> Result<T, A::Error> {
        T::First::deserialize(serde::de::value::SeqAccessDeserializer::new(seq)).map(T::short)
    }
    fn visit_f64<E: serde::de::Error>(self, v: f64) -> Result<T, E> {
        T::First::deserialize(v.into_deserializer()).map(T::short)
    }
    fn visit_i64<E: serde::de::Error>(self, v: i64) -> Result<T, E> {
        T::First::deserialize(v.into_deserializer()).map(T::short)
    }
    fn visit_bool<E: serde::de::Error>(self, v: bool) -> Result<T, E> {
        T::First::deserialize(v.into_deserializer()).map(T::short)
    }
    fn visit_str<E: serde::de::Error>(self, v: &str) -> Result<T, E> {
        T::First::deserialize(v.into_deserializer()).map(T::short)
    }
}

impl<T: Short + JsonSchema> JsonSchema for Brief<T> {
    fn schema_name() -> Cow<'static, str> {
        format!("{}OrShort", T::schema_name()).into()
    }
    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        let short = generator.subschema_for::<T::First>();
        let table = generator.subschema_for::<T>();
        json_schema!({ "anyOf": [short, table] })
    }
}
