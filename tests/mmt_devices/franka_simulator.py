"""An arm simulated by franky-sim in a process of its own, which stops on demand.

The simulator has no faults of its own, so that they are put into the states that it sends: a
program for the environment that has franky-sim, which reads what is to happen from its input.
"""

import subprocess
import sys
from contextlib import contextmanager

CARTESIAN_REFLEX = 7
"""Place of that error among those of libfranka."""


class SimulatedArm:
    """The process; see `simulated_arm`."""

    def __init__(self, host):
        self.host = host
        self.start()

    def start(self):
        """Start it, and wait until it takes connections."""
        self._process = subprocess.Popen(
            [sys.executable, __file__, self.host],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self._heard()

    def tell(self, what):
        """Have ``reflex``, ``user-stop`` or ``release`` happen."""
        self._process.stdin.write(what + "\n")
        self._process.stdin.flush()
        self._heard()

    def _heard(self):
        assert self._process.stdout.readline() == "done\n", "the simulator has ended"

    def kill(self):
        """End it, as a robot ends whose power fails."""
        self._process.kill()
        self._process.wait(60.0)
        for pipe in (self._process.stdin, self._process.stdout):
            pipe.close()


@contextmanager
def simulated_arm(host):
    """A simulated FR3 at an address of this machine's loopback network."""
    arm = SimulatedArm(host)
    try:
        yield arm
    finally:
        arm.kill()


def main(host):
    """Run the simulator until the input ends."""
    from franky_sim import SimulationServer, franka_robot_protocol, simulation_server
    from franky_sim.mujoco_simulator import MujocoSimulator

    modes = franka_robot_protocol.RobotMode
    statuses = franka_robot_protocol.MoveStatus

    class StoppingServer(simulation_server.FrankaRobotServer):
        fault: str = ""
        wanted: str = ""

        @property
        def robot_state(self):
            state = super().robot_state
            if self.fault == "user-stop":
                return state.replace(robot_mode=modes.kUserStopped)
            if self.fault == "reflex":
                errors = tuple(place == CARTESIAN_REFLEX for place in range(41))
                return state.replace(robot_mode=modes.kReflex, errors=errors, reflex_reason=errors)
            return state

        def process_commands(self):
            super().process_commands()
            wanted, self.wanted = self.wanted, ""
            if not wanted:
                return
            self.fault = "" if wanted == "release" else wanted
            moving = self.current_motion_id
            if self.fault and moving:
                self.stop_motion(send_preemption_signal=False)
                franka_robot_protocol.BaseCommand.send_response(
                    self._tcp_socket,
                    franka_robot_protocol.RobotCommand.kMove,
                    moving,
                    statuses.kReflexAborted if wanted == "reflex" else statuses.kEmergencyAborted,
                )
                self.reset_current_motion_id()
            print("done", flush=True)

    def recover(command, server):
        if server.fault == "reflex":
            server.fault = ""
        command.reply(franka_robot_protocol.AutomaticErrorRecoveryStatus.kSuccess)

    franka_robot_protocol.AutomaticErrorRecoveryCommand.handle = recover
    simulation_server.FrankaRobotServer = StoppingServer
    with MujocoSimulator(enable_visualization=False) as simulator:
        simulator.add_robot()
        with SimulationServer(simulator, hostname_candidates=[host]) as server:
            server.run_async()
            print("done", flush=True)
            for line in sys.stdin:
                server.robot_servers[0].wanted = line.strip()


if __name__ == "__main__":
    main(sys.argv[1])
