"""Cost, latency and accuracy of the device path, measured on emulated devices.

Three processes: the emulated devices (`emulated`), the follower's part with the real drivers
(`reader`), and the one that measures (`running`). All read the same monotonic clock, so that the
times of the emulated measurements and those of the frames can be compared.
"""
