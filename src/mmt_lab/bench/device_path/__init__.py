"""What the device path costs and how late and how true its frames are, on emulated devices.

Three processes: the emulated devices (`lab`), the follower's part with the real drivers
(`reader`), and whoever measures (`running`). All have the machine's one monotonic clock, so that
what the emulators measured when, and what the frames say, can be compared.
"""
