//! Fields that operations of one kind combine in a row. As pairs nested in each other, n operations would need n^2 bounds in
//! each leaf.

use crate::field::{Intersection, Union, WorldField};

/// The intersection (`All`) or the union (`Any`) of some fields, or one field that nothing is combined with yet.
pub(crate) enum Chain<'a> {
    One(Box<WorldField<'a>>),
    All(Vec<Box<WorldField<'a>>>),
    Any(Vec<Box<WorldField<'a>>>),
}

impl<'a> Chain<'a> {
    /// The combination as one field.
    pub fn into_field(self) -> Box<WorldField<'a>> {
        match self {
            Self::One(field) => field,
            Self::All(fields) => Box::new(Intersection(fields)),
            Self::Any(fields) => Box::new(Union(fields)),
        }
    }

    /// The intersection with another field. It extends a row of intersections; a union before it becomes one
    /// member.
    pub fn and(self, other: Box<WorldField<'a>>) -> Self {
        let mut fields = match self {
            Self::All(fields) => fields,
            own => vec![own.into_field()],
        };
        fields.push(other);
        Self::All(fields)
    }

    /// The union with another field. It extends a row of unions; an intersection before it becomes one member.
    pub fn or(self, other: Box<WorldField<'a>>) -> Self {
        let mut fields = match self {
            Self::Any(fields) => fields,
            own => vec![own.into_field()],
        };
        fields.push(other);
        Self::Any(fields)
    }
}
