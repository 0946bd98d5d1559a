"""What every layer uses: arrays, errors, frames, ticks, clocks, logs, compiled kernels."""
