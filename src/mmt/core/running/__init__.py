"""The running program: its process, signals, ticks, timers and end."""
