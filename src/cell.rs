//! Unit cells: symmetric Fourier series in an element's reference frame.
