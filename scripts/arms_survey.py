"""Import public arms from wheels of PyPI, run three laws on each with ``gains: auto``, write docs/arms-survey.md.

    pip download --no-deps -d wheels robosuite gymnasium dm_control pybullet example-robot-data
    .venv/bin/python scripts/arms_survey.py wheels

Every wheel is unpacked beside itself; nothing in it is run. An arm is taken as published, else with the flags that its
refusal names; where a file states no torque limits, each joint is given 100 N m, and the table says so.
"""

from __future__ import annotations

import re
import sys
import tempfile
import zipfile
from pathlib import Path

import torquebench
from torquebench.errors import TorquebenchError
from torquebench.robot.importing import ImportedArm, Options, RefusedArmError, import_arm, with_flags

ROBOTS = "cmeel.prefix/share/example-robot-data/robots/"
FILES = {
    "robosuite": [
        f"robosuite/models/assets/robots/{name}/robot.xml"
        for name in ("panda", "sawyer", "iiwa", "jaco", "kinova3", "ur5e", "xarm7", "baxter")
    ],
    "gymnasium": [
        f"gymnasium/envs/mujoco/assets/{name}.xml"
        for name in ("reacher", "pusher_v5", "inverted_pendulum", "inverted_double_pendulum")
    ],
    "dm_control": [
        *(f"dm_control/suite/{name}.xml" for name in ("reacher", "pendulum", "cartpole", "acrobot", "manipulator")),
        "dm_control/third_party/kinova/jaco_arm.xml",
    ],
    "pybullet": [
        f"pybullet_data/{name}.urdf" for name in ("franka_panda/panda", "kuka_iiwa/model", "xarm/xarm6_robot")
    ],
    "example_robot_data": [
        ROBOTS + name
        for name in (
            "panda_description/urdf/panda.urdf",
            "ur_description/urdf/ur5_robot.urdf",
            "ur_description/urdf/ur5_gripper.urdf",
            "ur_description/urdf/ur10_robot.urdf",
            "kinova_description/robots/kinova.urdf",
            "xarm_description/urdf/xarm7.urdf",
            "z1_description/urdf/z1.urdf",
            "so_arm_description/urdf/so100.urdf",
            "so_arm_description/urdf/so101.urdf",
            "talos_data/robots/talos_left_arm.urdf",
        )
    ],
}
"""Distribution -> files of arms in its wheel."""
LAWS = {
    "computed torque": {"law": "computed-torque"},
    "PD + gravity": {"law": "pd-gravity"},
    "SMC": {"law": "smc", "switching": "saturation"},
}
GIVEN = 100.0
"""Torque limit of joints whose file states none [N m; N for slides]."""


def imported(path: Path) -> tuple[ImportedArm, str]:
    """Return an arm, and how it was taken: empty as published, else flags."""
    options = Options()
    for _ in range(4):
        try:
            arm = import_arm(path, options)
            break
        except RefusedArmError as error:
            bare = [part for part in error.findings if part.verdict == "refused" and part.what == "torque limits"]
            limits = {name: GIVEN for part in bare for name in part.places}
            if not limits and not error.flags:
                raise
            known = options.torque_limits if isinstance(options.torque_limits, dict) else {}
            told = Options(options.fix, options.base, options.tip, options.tool, known | limits, options.drop)
            options = with_flags(told, error.flags)
    else:
        raise SystemExit(f"{path}: flags do not take it")
    flags = [f"--fix {','.join(options.fix)}"] if options.fix else []
    flags += [f"--tip {options.tip}"] if options.tip else []
    flags += [f"--drop {word}" for word in options.drop]
    flags += [f"--torque-limits {GIVEN:g} for {len(options.torque_limits)} joints"] if options.torque_limits else []
    return arm, "; ".join(flags)


def run(arm: ImportedArm, folder: Path) -> list[str]:
    """Return RMSE or outcome of each law on a sine of 0.2 rad from home, and the time step."""
    file = folder / f"{arm.name}.xml"
    file.write_text(arm.mjcf)
    for step in (1e-3, 1e-4, 1e-5):
        config = {
            "name": "survey",
            "plant": {"model": file, "timestep": step},
            "controllers": [
                {"name": re.sub(r"\W+", "-", name.lower()), "gains": "auto", **own} for name, own in LAWS.items()
            ],
            "reference": {"kind": "sine", "amplitude": 0.2, "frequency_hz": 0.5},
            "run": {"duration": 2.0, "initial_q": "key:home", "control_period": 1e-3},
        }
        try:
            result = torquebench.run_experiment(torquebench.load_experiment(config))
        except TorquebenchError as error:
            if "shorter time step" in str(error):
                continue
            return [str(error).splitlines()[0]] * len(LAWS) + [f"{1e3 * step:g}"]
        table = result.to_dataframe()
        cells = [f"{1e3 * row.rmse:.3g}" if row.outcome == "COMPLETED" else row.outcome for row in table.itertuples()]
        return [*cells, f"{1e3 * step:g}"]
    return ["friction too steep"] * len(LAWS) + [""]


def write(rows: list[str], counts: dict[str, int]) -> None:
    """Write the page."""
    told = ", ".join(f"{count} {how}" for how, count in counts.items())
    laws = " | ".join(f"{name}: RMSE [mrad]" for name in LAWS)
    text = f"""# Public arms

Written by `scripts/arms_survey.py` from wheels of PyPI: {len(rows)} files, {told}. `proved` is the largest
relative difference of mass matrix, bias, inverse dynamics and tool to the published file, in plain MuJoCo at 100
random states. The laws have `gains: auto` at 1 ms and follow a sine of 0.2 rad (slides: 0.2 m) at 0.5 Hz from home;
RMSE is over all joints, from 1 s on. Their model is exact but for the friction and damping of the file, which no law
knows: where all three err by several mrad, the file has much of it on light links. Where all three err by hundreds of
mrad the torque limit is below what the motion takes, as the run says before it starts: pendulum and acrobot of
dm_control are made to be swung up.

| from | file | joints | taken | proved | {laws} | time step [ms] |
{"|---" * (6 + len(LAWS))}|
"""
    page = Path(__file__).parents[1] / "docs" / "arms-survey.md"
    page.write_text(text + "\n".join(rows) + "\n", encoding="utf-8")


def main() -> None:
    """Survey the arms; the page is there from the first on."""
    wheels, rows = Path(sys.argv[1]), list[str]()
    counts = {"as published": 0, "with flags": 0, "refused": 0}
    for distribution, files in FILES.items():
        wheel = max(wheels.glob(f"{distribution}-*.whl"))
        version, unpacked = wheel.name.split("-")[1], wheel.with_suffix("")
        if not unpacked.is_dir():
            zipfile.ZipFile(wheel).extractall(unpacked)
        for file in files:
            short = file.removeprefix(ROBOTS).removeprefix("robosuite/models/assets/robots/")
            begin = f"| {distribution} {version} | `{short}` "
            try:
                arm, flags = imported(unpacked / file)
            except TorquebenchError as error:
                counts["refused"] += 1
                why = str(error).splitlines()[0].replace(str(unpacked), "").partition(": ")[2]
                rows.append(f"{begin}| | refused: {why} |" + " |" * (2 + len(LAWS)))
            else:
                counts["with flags" if flags else "as published"] += 1
                with tempfile.TemporaryDirectory() as folder:
                    cells = [f"{arm.proof.worst:.0e}", *run(arm, Path(folder))]
                rows.append(f"{begin}| {len(arm.joints)} | {flags or 'as published'} | {' | '.join(cells)} |")
            write(rows, counts)


if __name__ == "__main__":
    main()
