"""A plug-in for LeRobot: mmt's leader and follower as a robot and a teleoperator.

LeRobot loads it by ``--robot.discover_packages_path=mmt.lerobot``, which imports every module here.
Only `mmt.lerobot.config_devices` and `mmt.lerobot.devices` import LeRobot.
"""
