"""A plug-in for LeRobot: mmt's leader and follower as a robot and a teleoperator.

LeRobot loads it by ``--robot.discover_packages_path=mmt_bridges.lerobot``, which imports every
module here. Only `mmt_bridges.lerobot.config_devices` and `mmt_bridges.lerobot.devices` import
LeRobot.
"""
