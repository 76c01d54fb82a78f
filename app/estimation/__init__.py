"""Pure numerics: arrays in, arrays out; no clock, no I/O."""
