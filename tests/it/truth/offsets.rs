//! Offsets are metric: Steiner's formula, walls, fillets.
