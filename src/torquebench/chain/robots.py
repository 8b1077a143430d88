"""Chains of robots: every number with the document that it comes from, or with why it is assumed to have that size."""

from __future__ import annotations

import math

from torquebench.chain.chain import ABOUT, Chain, Origin, chain
from torquebench.chain.drives import CurrentLoop, TorqueSpeed

TOOLBOX = "https://github.com/petercorke/robotics-toolbox-python/blob/master/roboticstoolbox/models/DH/Puma560.py"
UR_TORQUE = "https://docs.ros.org/en/jazzy/p/ur_client_library/doc/examples/direct_torque_control.html"
UR_RTDE = "https://pypi.org/project/ur-rtde/"
FRANKA_RATES = "https://github.com/frankaemika/libfranka/blob/master/include/franka/rate_limiting.h"
FRANKA_FILTER = "https://docs.ros.org/en/kinetic/api/libfranka/html/lowpass__filter_8h.html"
KUKA_FRI = (
    "https://industrialmonitordirect.com/blogs/knowledgebase/kuka-lbr-iiwa-fri-torque-pid-control-implementation-guide"
)
ROBOTIS_SERVO = "https://emanual.robotis.com/docs/en/dxl/x/xm540-w270"
STS3215 = "https://github.com/TheRobotStudio/SO-ARM100/issues/134"
ROBOTIS_STEP = "https://emanual.robotis.com/docs/en/platform/turtlebot3/appendix_dynamixel"

DIFFERENCE = Origin("assumed: there are encoders and no tachometers, so a velocity is a difference of positions")
NEXT_CYCLE = Origin("assumed: a command computed in one period acts from the next one on")
STEP_20_BITS = Origin("assumed: 20 bits a turn of the joint, 2 pi/2^20; the maker prints none")


def _filter(rate: float, period: float) -> Origin:
    lag = f"{1e3 / rate:g} ms, {1.0 / (rate * period):g} periods"
    return Origin(f"assumed: {lag}, of smoothing, for the difference of an encoder's steps is rough")


@chain(
    "puma560-unimate",
    control_period=0.001,
    origins={
        "control_period": Origin("assumed: computers that take the place of Unimate's servo boards run at 1 kHz"),
        "quantisation": Origin(
            "2 pi/(1000 x 53.7063): the coarsest of the first three joints, whose gear ratio is that of Corke and "
            "Armstrong-Helouvry (ICRA 1994); assumed: 1000 counts a turn of the motor",
            TOOLBOX,
        ),
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(200.0, 0.001),
        "command_delay": NEXT_CYCLE,
        "current_loop": Origin("assumed: analogue current loops of that time reach about 150 Hz"),
    },
)
def puma560_unimate() -> Chain:
    """A PUMA 560 whose Unimate servo boards are replaced by a computer: encoders on the motors, torque by current.

    Its friction belongs to the plant. Left out: the torque-speed line and the converters' steps, for want of a source.
    """
    return Chain(
        quantisation=2.0 * math.pi / (1000.0 * 53.7063),
        velocity="differentiated",
        velocity_filter=200.0,
        command_delay=0.001,
        current_loop=CurrentLoop(frequency=1000.0),
    )


@chain(
    "ur5e",
    control_period=0.002,
    origins={
        "control_period": Origin("500 Hz, at which ur_rtde's interfaces are opened for direct torques", UR_RTDE),
        "quantisation": STEP_20_BITS,
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(250.0, 0.002),
        "command_delay": Origin(
            "one period: ur_client_library sends a torque as command for the next cycle", UR_TORQUE
        ),
        "current_loop": Origin("assumed: 160 Hz, a third of the control rate; the maker prints none"),
    },
)
def ur5e() -> Chain:
    """A UR5e under direct torque control: 500 Hz, each command one period late."""
    return Chain(
        quantisation=2.0 * math.pi / 2**20,
        velocity="differentiated",
        velocity_filter=250.0,
        command_delay=0.002,
        current_loop=CurrentLoop(frequency=1000.0),
    )


@chain(
    "fr3",
    control_period=0.001,
    origins={
        "control_period": Origin("1 kHz, kDeltaT of libfranka", FRANKA_RATES),
        "quantisation": STEP_20_BITS,
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(500.0, 0.001),
        "command_filter": Origin(
            "2 pi 100 Hz: libfranka's filter of commands, kDefaultCutoffFrequency, ahead of the rate limit; the torque "
            "loop inside is taken to be faster",
            FRANKA_FILTER,
        ),
        "torque_rate": Origin(
            "1000 N m/s on every joint, kMaxTorqueRate of libfranka; beyond it the arm stops", FRANKA_RATES
        ),
        "command_delay": NEXT_CYCLE,
    },
)
def fr3() -> Chain:
    """A Franka Research 3 on its control interface: 1 kHz, commands filtered at 100 Hz, 1000 N m/s at most."""
    return Chain(
        quantisation=2.0 * math.pi / 2**20,
        velocity="differentiated",
        velocity_filter=500.0,
        command_filter=200.0 * math.pi,
        torque_rate=1000.0,
        command_delay=0.001,
    )


@chain(
    "iiwa14",
    control_period=0.001,
    origins={
        "control_period": Origin("1 kHz, the fastest of KUKA's fast robot interface (1 to 10 ms)", KUKA_FRI),
        "quantisation": STEP_20_BITS,
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(250.0, 0.001),
        "measurement_delay": Origin("assumed: a state is sent at one instant and is there at the next"),
        "command_delay": NEXT_CYCLE,
        "current_loop": Origin(
            "assumed: about 100 Hz, as an inner loop around elastic joints with torque sensors allows"
        ),
    },
)
def iiwa14() -> Chain:
    """A KUKA LBR iiwa 14 under torques over its fast robot interface: 1 kHz, two periods of delay in all."""
    return Chain(
        quantisation=2.0 * math.pi / 2**20,
        velocity="differentiated",
        velocity_filter=250.0,
        measurement_delay=0.001,
        command_delay=0.001,
        current_loop=CurrentLoop(frequency=600.0),
    )


@chain(
    "dynamixel",
    control_period=0.005,
    origins={
        "control_period": Origin(
            "assumed: 200 Hz, for reading and writing six servos at 1 Mbit/s takes 2 ms on the wire, and 2 ms by USB"
        ),
        "quantisation": Origin("12 bits a turn, 4096 steps, as of most small servos", ROBOTIS_SERVO),
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(50.0, 0.005),
        "command_delay": NEXT_CYCLE,
        "torque_quantum": Origin(
            "2.69 mA x 2.409 N m/A: a step of the current, and the torque at stall for it", ROBOTIS_STEP
        ),
        "actuator_lag": Origin("assumed: 3 ms, as small motors with gears of 270 to 1 and pulsed current take"),
        "torque_speed": Origin(
            "a straight line from stall to 30 rev/min without load, XM540-W270 at 12 V", ROBOTIS_SERVO
        ),
    },
)
def dynamixel() -> Chain:
    """Small servos on one bus, such as Dynamixel's XM540, with the torque by their current: 12 bits, 200 Hz.

    Backlash is left out.
    """
    return Chain(
        quantisation=2.0 * math.pi / 4096.0,
        velocity="differentiated",
        velocity_filter=50.0,
        command_delay=0.005,
        torque_quantum=0.00269 * 2.409,
        actuator_lag=0.003,
        torque_speed=TorqueSpeed(corner=0.0, no_load=math.pi),
    )


@chain(
    "so101",
    control_period=0.01,
    origins={
        "control_period": Origin(
            "assumed: 100 Hz, for reading six servos one after the other and writing them at 1 Mbit/s takes 5 ms by USB"
        ),
        "quantisation": Origin("12 bits a turn, 4096 steps, of an STS3215", STS3215),
        "velocity": DIFFERENCE,
        "velocity_filter": _filter(30.0, 0.01),
        "command_delay": NEXT_CYCLE,
        "torque_quantum": Origin("assumed: a thousandth of the 2.94 N m at stall (30 kg cm), as a duty cycle is set"),
        "actuator_lag": Origin("assumed: 3 ms, as of other small motors with gears"),
        "torque_speed": Origin("a straight line from stall to 45 rev/min without load, STS3215 at 12 V", STS3215),
    },
)
def so101() -> Chain:
    """An SO-101's STS3215 servos, with the motors' duty cycle as torque: 12 bits, 100 Hz, 45 rev/min.

    Their own position loop is the law `position-servo`. Left out is the backlash, of which 0.5 deg are promised and
    about 1 deg was measured: `plant.transmission.backlash: 17 mrad`.
    """
    return Chain(
        quantisation=2.0 * math.pi / 4096.0,
        velocity="differentiated",
        velocity_filter=30.0,
        command_delay=0.01,
        torque_quantum=0.00294,
        actuator_lag=0.003,
        torque_speed=TorqueSpeed(corner=0.0, no_load=1.5 * math.pi),
    )


ROBOT_CHAINS = tuple(name for name, about in ABOUT.items() if about.origins)
"""Names of the chains of robots."""
