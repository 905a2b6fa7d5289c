//! Fits keep what lies below Nyquist; volume fractions count the element's map.
