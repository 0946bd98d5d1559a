"""Tools of every layer: arrays, errors, frames, ticks, clocks, logs, compiled kernels."""
