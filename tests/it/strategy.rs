//! Proptest strategies that several modules share.
