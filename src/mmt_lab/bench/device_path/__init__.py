"""Cost, latency and accuracy of the device path, measured on emulated devices.

There are three processes: the emulated devices (`emulated`), the real drivers and the frames as in
the follower (`reader`), and the measuring process (`running`). All read the same monotonic clock,
so that the times of the emulated measurements and those of the frames can be compared.
"""
