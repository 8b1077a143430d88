"""Configs with one mistake each: the edit that makes it, and what the user must be told."""

from __future__ import annotations

from typing import NamedTuple

from tests.experiment.examples import ANALYTIC, FUZZY, GOOD, QUINTIC, SCENARIO, STEP, edited, line_of


class Bad(NamedTuple):
    """One edit of a good config that must be refused with exactly one message."""

    old: str
    new: str
    key: str
    """Dotted key the message must name."""
    word: str
    """What the message must contain."""
    on: str | None = None
    """A piece of the line the message must point at, when that is not the line of the edit."""
    text: str = GOOD

    @property
    def config(self) -> str:
        """The broken config."""
        return edited(self.old, self.new, self.text)

    @property
    def line(self) -> int:
        """Line the message must point at."""
        if self.on is not None:
            return line_of(self.on, self.config)
        pairs = enumerate(zip(self.text, self.config, strict=False))
        differs = next((i for i, (before, after) in pairs if before != after), len(self.text))
        return self.config.count("\n", 0, differs) + 1


NOISE, FIRST, SECOND = "- kind: band-limited-noise", "- name: conventional", "- name: linear-band"
EQ, GAINS, AMP = "controllers[0].equivalent_control", "controllers[0].gains", "reference.amplitude"

UNKNOWN_KEYS = [
    Bad("chain: ideal", "chain: ideal\ncolour: red", "colour", "unknown key"),
    Bad("  engine: mujoco", "  engine: mujoco\n  wheels: 4", "plant.wheels", "unknown key"),
    Bad(
        "      lam: 10\n",
        "      lam: 10\n      lamda: 3\n",
        f"{GAINS}.lamda",
        "unknown gain (did you mean 'lam'?)",
    ),
    Bad("      kv: 20", "      kv: 20\n      ki: 1", "controllers[1].gains.ki", "unknown gain"),
    Bad("    law: smc", "    law: smc\n    k: 0.3", "controllers[0].k", "under gains"),
    Bad("kv: 20", "kv: 20\n      switching: sign", "controllers[1].gains.switching", "unknown gain"),
    Bad("phi: [", "switching: sign\n      phi: [", f"{GAINS}.switching", "beside gains"),
    Bad(
        "law: linear-band-smc",
        "law: linear-band-smc\n    surface: pid",
        "controllers[1].surface",
        ", smc)",
    ),
    Bad("  seed: 7", "  seed: 7\n  timestep: 0.1", "run.timestep", "in plant"),
    Bad("  quality: pretty", "  qualty: pretty", "video.qualty", "unknown key (did you mean 'quality'?)"),
    Bad("chain: ideal", "chain: ideal\nseed: 1", "seed", "in run"),
    Bad("  frequency_hz: 0.75", "  frequency_hz: 0.75\n  rise_time: 1", "reference.rise_time", "quintic, ramp"),
    Bad("  integrator: rk4", "  integrator: rk4\n  constants: fitted", "plant.constants", "engine: analytic"),
    Bad("    relative: 0.3", "    relative: 0.3\n    percent: 1", "model.mismatch.percent", "unknown key"),
    Bad("    hold: 0.02", "    hold: 0.02\n    power: 2", "disturbances[0].power", "unknown key"),
    Bad("    hold: 0.02", '    hold: 0.02\n    "hold ": 2', "disturbances[0].'hold '", "'hold'"),
    Bad("  seed: 7", "  seed: 7\n  Draw: 2", "run.Draw", "did you mean 'draw'"),
]

MISSING_KEYS = [
    Bad("  model: puma560\n", "", "plant.model", "missing", "plant:"),
    Bad("relative: 0.3", "{}", "model.mismatch", "missing: one of relative, tolerance, constants", "mismatch:"),
    Bad("    law: smc\n", "", "controllers[0].law", "missing", FIRST),
    Bad(
        "      k: 0.3\n",
        "",
        f"{GAINS}.k",
        "gain 'k' is missing",
        "gains: # first",
        GOOD.replace("gains:", "gains: # first", 1),
    ),
    Bad(
        "      kv: 20\n",
        "",
        "controllers[1].gains.kv",
        "missing",
        "gains: # 2",
        GOOD.replace("false\n    gains:", "false\n    gains: # 2"),
    ),
    Bad("  kind: sine\n", "", "reference.kind", "missing", "reference:"),
    Bad("  frequency_hz: 0.75\n", "", "reference.frequency_hz", "missing", "reference:"),
    Bad("  at: 0.2\n", "", "reference.at", "missing", "reference:", STEP),
    Bad("  rise_time: 2\n", "", "reference.rise_time", "missing", "reference:", QUINTIC),
    Bad("    sigma: 0.5\n", "", "disturbances[0].sigma", "missing", NOISE),
    Bad("  duration: 4\n", "", "run.duration", "missing", "run:"),
    Bad(
        "      phi: [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]\n",
        "",
        f"{GAINS}.phi",
        "missing",
        "gains: # first",
        GOOD.replace("gains:", "gains: # first", 1),
    ),
]

WRONG_TYPES = [
    Bad("name: good", "name: 12", "name", "quotes"),
    Bad("name: good", "name: true", "name", "wanted text"),
    Bad("name: good", "name: [a]", "name", "a list of 1"),
    Bad("name: good", "name: {}", "name", "an empty mapping"),
    Bad("description: every section, one key per line", "description: 5", "description", "quotes"),
    Bad("description: every section, one key per line", "description:", "description", "nothing"),
    Bad("timestep: 0.001", "timestep: '0.001'", "plant.timestep", "remove the quotes"),
    Bad("timestep: 0.001", "timestep: true", "plant.timestep", "got true, wanted a number [s]"),
    Bad("timestep: 0.001", "timestep: [0.001]", "plant.timestep", "a list of 1"),
    Bad("duration: 4", "duration: 010", "run.duration", "leading zeros"),
    Bad("duration: 4", "duration: 1:30", "run.duration", "90 rather than 1:30"),
    Bad("duration: 4", "duration: 4 m", "run.duration", "one of the units s, ms, us, min"),
    Bad("duration: 4", "duration: 4 %", "run.duration", "one of the units s, ms, us, min"),
    Bad("duration: 4", "duration: 4_000", "run.duration", "without _"),
    Bad("duration: 4", "duration: 4,5", "run.duration", "decimal sign is a point"),
    Bad("duration: 4", "duration: 0x10", "run.duration", "write it in decimal"),
    Bad("duration: 4", "duration: 2 * 2", "run.duration", "no formulas"),
    Bad("duration: 4", "duration: ~", "run.duration", "nothing"),
    Bad("duration: 4", "duration: inf", "run.duration", "finite"),
    Bad("relative: 0.3", "relative: 130%", "model.mismatch.relative", "less than 1"),
    Bad("relative: 0.3", "relative: 30 deg", "model.mismatch.relative", "one of the units %"),
    Bad("seed: 7", "seed: 7.0", "run.seed", "whole number"),
    Bad("seed: 7", "seed: '7'", "run.seed", "remove the quotes"),
    Bad("seed: 7", "seed: true", "run.seed", "whole number"),
    Bad("draw: 3", "draw: 3.5", "run.draw", "whole number"),
    Bad("equivalent_control: true", "equivalent_control: yes", EQ, "true, false, measured-acceleration; yes, no"),
    Bad("equivalent_control: true", "equivalent_control: on", EQ, "are text"),
    Bad("equivalent_control: true", "equivalent_control: 1", EQ, "got 1, wanted one of true, false, measured"),
    Bad("equivalent_control: true", "equivalent_control: True", EQ, "in small letters"),
    Bad("equivalent_control: true", "equivalent_control: 'true'", EQ, "without quotes"),
    Bad("equivalent_control: true", "equivalent_control: measured", EQ, "did you mean 'measured-acceleration'"),
    Bad("switching: saturation", "switching: saturation\n    surface: pdi", "controllers[0].surface", "pd, pi, pid"),
    Bad("switching: saturation", "switching: true", "controllers[0].switching", "sign, saturation"),
    Bad("[1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "large", AMP, "wanted a number [rad], or a list"),
    Bad("[1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "{a: 1}", AMP, "a mapping"),
    Bad("1.1", "'1.1'", f"{AMP}[3]", "remove the quotes"),
    Bad("1.1", "true", f"{AMP}[3]", "got true"),
    Bad("1.1", "[1.1]", f"{AMP}[3]", "a list of 1"),
    Bad("1.1", "~", f"{AMP}[3]", "nothing"),
    Bad("kind: sine", "kind: [sine]", "reference.kind", "one of quintic, ramp, sine, step"),
    Bad("kind: sine", "kind: true", "reference.kind", "got true"),
    Bad("kind: sine", "kind:", "reference.kind", "nothing"),
    Bad("initial_q: home", "initial_q: {q: 1}", "run.initial_q", "a mapping"),
    Bad("    relative: 0.3", "    - 0.3", "model.mismatch", "a list of 1"),
    Bad("initial_q: home", "initial_q: [x]", "run.initial_q[0]", "wanted a number [rad]"),
    Bad("kv: 20", "kv: twenty", "controllers[1].gains.kv", "wanted a number [1/s], or a list"),
]

WRONG_SHAPES = [
    Bad("[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]", "[0.1, 0.2]", f"{GAINS}.phi", "wanted one number or 6"),
    Bad("1.1, ", "", AMP, "got 5 numbers"),
    Bad("frequency_hz: 0.75", "frequency_hz: []", "reference.frequency_hz", "empty list"),
    Bad("sigma: 0.5", "sigma: [1, 2, 3, 4, 5, 6, 7]", "disturbances[0].sigma", "got 7 numbers"),
    Bad("initial_q: home", "initial_q: [0]", "run.initial_q", "wanted one number or 6"),
]

BAD_NUMBERS = [
    Bad("timestep: 0.001", "timestep: 0", "plant.timestep", "more than 0"),
    Bad("timestep: 0.001", "timestep: -1", "plant.timestep", "got -1, wanted more than 0"),
    Bad("timestep: 0.001", "timestep: .nan", "plant.timestep", "finite"),
    Bad("timestep: 0.001", "timestep: nan", "plant.timestep", "finite"),
    Bad("control_period: 0.002", "control_period: -0.002", "run.control_period", "more than 0"),
    Bad("control_period: 0.002", "control_period: 0.0", "run.control_period", "more than 0"),
    Bad("duration: 4", "duration: .inf", "run.duration", "finite"),
    Bad("duration: 4", "duration: 1e999", "run.duration", "finite"),
    Bad("duration: 4", "duration: -.inf", "run.duration", "finite"),
    Bad("seed: 7", "seed: -1", "run.seed", "at least 0"),
    Bad("seed: 7", "seed: 9223372036854775808", "run.seed", "at most 9223372036854775807"),
    Bad("seed: 7", "seed: " + "9" * 5000, "run.seed", "whole number"),
    Bad("draw: 3", "draw: -3", "run.draw", "at least 0"),
    Bad("metrics_from: 1.25", "metrics_from: -1", "run.metrics_from", "at least 0"),
    Bad("relative: 0.3", "relative: -0.1", "model.mismatch.relative", "at least 0"),
    Bad("relative: 0.3", "relative: 1", "model.mismatch.relative", "less than 1"),
    Bad("relative: 0.3", "relative: 30", "model.mismatch.relative", "it is a fraction: 0.3 for 30 %"),
    Bad("at: 0.2", "at: -0.2", "reference.at", "at least 0", text=STEP),
    Bad("rise_time: 2", "rise_time: 0", "reference.rise_time", "more than 0", text=QUINTIC),
    Bad("frequency_hz: 0.75", "frequency_hz: [1, 1, -2, 1, 1, 1]", "reference.frequency_hz[2]", "at least 0"),
    Bad("sigma: 0.5", "sigma: -0.5", "disturbances[0].sigma", "at least 0"),
    Bad("    hold: 0.02", "    hold: 0", "disturbances[0].hold", "more than 0"),
    Bad("clip_sigma: 2.5", "clip_sigma: 0", "disturbances[0].clip_sigma", "more than 0"),
    Bad("1.1", ".nan", f"{AMP}[3]", "finite"),
    Bad("k: 0.25", "k: -0.25", "controllers[1].gains.k", "more than 0"),
    Bad("k: 0.25", "k: 0", "controllers[1].gains.k", "more than 0"),
    Bad("phi: 0.35", "phi: .inf", "controllers[1].gains.phi", "finite"),
    Bad("phi: [0.1, 0.2", "phi: [0.1, -0.2", f"{GAINS}.phi[1]", "more than 0"),
]

BAD_NAMES = [
    Bad("engine: mujoco", "engine: mujocco", "plant.engine", "did you mean 'mujoco'"),
    Bad("model: puma560", "model: pumma560", "plant.model", "did you mean 'puma560'"),
    Bad("model: puma560", "model: ../../etc/passwd", "plant.model", "is outside the folder"),
    Bad("model: puma560", "model: /etc/passwd", "plant.model", "is outside the folder"),
    Bad("model: puma560", "model: arms/none.xml", "plant.model", "there is no file"),
    Bad("model: puma560", "model: ''", "plant.model", "not a plain name"),
    Bad("integrator: rk4", "integrator: rk45", "plant.integrator", "did you mean 'rk4'"),
    Bad("structure: corrected", "structure: corected", "model.structure", "did you mean 'corrected'"),
    Bad("constants: printed", "constants: print", "model.constants", "did you mean 'printed'"),
    Bad("law: smc", "law: smcc", "controllers[0].law", "did you mean 'smc'"),
    Bad("law: smc", "law: SMC", "controllers[0].law", "did you mean 'smc'"),
    Bad("law: smc", "law: backstepping", "controllers[0].law", "--plugin FILE"),
    Bad("law: linear-band-smc", "law: linear-bend-smc", "controllers[1].law", "did you mean 'linear-band-smc'"),
    Bad(
        "switching: saturation",
        "switching: saturated",
        "controllers[0].switching",
        "did you mean 'saturation'",
    ),
    Bad("expect: completed", "expect: complete", "controllers[1].expect", "did you mean 'completed'"),
    Bad("kind: sine", "kind: sin", "reference.kind", "did you mean 'sine'"),
    Bad("kind: quintic", "kind: quinitc", "reference.kind", "did you mean 'quintic'", text=QUINTIC),
    Bad("chain: ideal", "chain: fats", "chain", "did you mean 'fast'?"),
    Bad("kind: band-limited-noise", "kind: bandlimited-noise", "disturbances[0].kind", "'band-limited-noise'"),
    Bad("channel: torque", "channel: torqe", "disturbances[0].channel", "did you mean 'torque'"),
    Bad("initial_q: home", "initial_q: hom", "run.initial_q", "did you mean 'home'"),
    Bad("name: good", "name: Good One", "name", "slug"),
    Bad("name: good", "name: ../evil", "name", "slug"),
    Bad("name: good", "name: ''", "name", "slug"),
    Bad("name: good", "name: -a", "name", "slug"),
    Bad("name: good", "name: " + "a" * 65, "name", "slug"),
    Bad("name: linear-band", "name: linear_band", "controllers[1].name", "slug"),
    Bad("name: linear-band", "name: conventional", "controllers[1].name", "already"),
    Bad("name: linear-band", "name: figures", "controllers[1].name", "the figures' folder"),
]

CONTRADICTIONS = [
    Bad("timestep: 0.001", "timestep: 0.0003", "run.control_period", "nearest is 0.0021", "control_period"),
    Bad("timestep: 0.001", "timestep: 0.003", "run.control_period", "nearest is 0.003", "control_period"),
    Bad("control_period: 0.002", "control_period: 0.0015", "run.control_period", "plant.timestep, 0.001 s"),
    Bad(
        "timestep: 0.001",
        "timestep: 0.003",
        "run.control_period",
        "got 0.001 s",
        text=GOOD.replace("  control_period: 0.002\n", ""),
    ),
    Bad(
        "control_period: 0.002",
        "control_period: 0.004",
        "disturbances[0].hold",
        "got 0.01 s",
        text=GOOD.replace("    hold: 0.02\n", ""),
    ),
    Bad("duration: 4", "duration: 4.001", "run.duration", "run.control_period, 0.002 s; the nearest is 4"),
    Bad("    hold: 0.02", "    hold: 0.021", "disturbances[0].hold", "run.control_period, 0.002 s"),
    Bad("    hold: 0.02", "    hold: 0.001", "disturbances[0].hold", "nearest is 0.002"),
    Bad("metrics_from: 1.25", "metrics_from: 3.75", "run.metrics_from", "4.25 s"),
    Bad("duration: 4", "duration: 1.5", "run.metrics_from", "1.75 s", "metrics_from"),
    Bad(
        "  duration: 4\n",
        "  duration: 2.4\n",
        "run.duration",
        "2.5 s",
        None,
        STEP.replace("  metrics_from: 1.25\n", ""),
    ),
    Bad("at: 0.2", "at: 4", "reference.at", "less than run.duration", text=STEP),
    Bad("rise_time: 2", "rise_time: 4.01", "reference.rise_time", "never reached", text=QUINTIC),
    Bad(
        "constants: fitted",
        "constants: printed",
        "plant.constants",
        "seven exact ties",
        text=ANALYTIC.replace("structure: printed", "structure: exact"),
    ),
    Bad("switching: saturation", "switching: sign", f"{GAINS}.phi", "no effect", "phi: [0.1"),
    Bad("    switching: saturation\n", "", f"{GAINS}.phi", "no effect", "phi: [0.1"),
    Bad(
        "compensation: fuzzy",
        "compensation: clipped-sum",
        "controllers[1].fuzzy",
        "unless compensation: fuzzy",
        "    fuzzy: three",
        FUZZY,
    ),
    Bad(
        "  structure: corrected\n  constants: printed\n  mismatch:\n    relative: 0.3",
        "  constants: printed",
        "model.constants",
        "seven exact ties",
    ),
    Bad("timestep: 0.001", "timestep: 1e-8", "run.duration", "lower run.duration", "duration: 4"),
    Bad("duration: 4", "duration: 4000", "run.duration", "GiB"),
]

BAD_YAML = [
    Bad("name: good", "name: good\nname: again", "name", "first given on line 1"),
    Bad("  seed: 7", "  seed: 7\n  seed: 8", "run.seed", "duplicate key"),
    Bad("  seed: 7", "  seed: &anchor 7", "run.seed", "anchors"),
    Bad("seed: 7", "seed: *anchor", "run.seed", "aliases"),
    Bad("  seed: 7", "  seed: 7\n  6: 1", "run", "the decimal sign is a point"),
    Bad("  seed: 7", "  seed: 7\n  <<: {draw: 4}", "run", "merge keys"),
    Bad("seed: 7", "seed: !!int 7", "run.seed", "!!int"),
    Bad("seed: 7", "seed: ! 7", "run.seed", "tags"),
    Bad(
        "seed: 7",
        "seed: !!python/object/apply:os.system ['true']",
        "run.seed",
        "!!python/object/apply:os.system",
    ),
    Bad("run:", "run: !!map", "run", "!!map"),
    Bad("  seed: 7", "  7: seed\n  seed: 7", "run", "key must be a word"),
    Bad("  seed: 7", "  true: seed\n  seed: 7", "run", "key must be a word"),
    Bad("  seed: 7", "  ? [a, b]\n  : 1\n  seed: 7", "run", "key must be a word"),
    Bad("  seed: 7", "\tseed: 7", "", "tabs"),
    Bad("  seed: 7", " seed: 7", "", "not valid YAML"),
    Bad("description: every", "description: a: b: every", "", "not valid YAML"),
    Bad("description: every", "description: @every", "", "quotes"),
    Bad("description: every", "description: \u2028every", "", "U+2028"),
    Bad("description: every section, one key per line", 'description: "\\u0007"', "description", "U+0007"),
    Bad("description: every", "description: \x07every", "", "U+0007"),
    Bad("description: every", "description: \u202eevery", "", "U+202E"),
]

THREE, LIST = "fuzzy.three", "fuzzy.list"
WIDE, NARROW = "terms: {N: -2, Z: 0, P: 2}\n      - terms", "{N: [-1, -1, 0], Z: [-0.5, -0.1, 0.1, 0.5], P: [0, 1, 1]}"


def bad_fuzzy(old: str, new: str, key: str, word: str, on: str | None = None) -> Bad:
    """Return one edit of the config with fuzzy systems."""
    return Bad(old, new, key, word, on, FUZZY)


FUZZY_SYSTEMS = [
    bad_fuzzy("fuzzy: three", "fuzzy: tree", "controllers[1].fuzzy", "did you mean 'three'"),
    bad_fuzzy("fuzzy: three", "fuzzy: pd-94", "controllers[1].fuzzy", "pd-49, pd-25, pd-9, s-7, three, list"),
    bad_fuzzy("fuzzy: three", "fuzzy: 49", "controllers[1].fuzzy", "got 49, wanted text"),
    bad_fuzzy("    law: smc", "    law: smc\n    fuzzy: three", "controllers[0].fuzzy", "fuzzy-linear-band-smc"),
    bad_fuzzy("kv: 20", "kv: 20\n      fuzzy: pd-9", "controllers[1].gains.fuzzy", "unknown gain"),
    bad_fuzzy("kf: 0.3", "kf: -0.3", "controllers[1].gains.kf", "at least 0"),
    Bad(
        "      gd: 1.0\n",
        "",
        "controllers[1].gains.gd",
        "gain 'gd' is missing",
        "gains: # 2",
        FUZZY.replace("three\n    gains:", "three\n    gains: # 2"),
    ),
    bad_fuzzy("  list:\n", "  List:\n", "fuzzy.List", "not a slug"),
    bad_fuzzy("  list:\n", "  pd-25:\n", "fuzzy.pd-25", "'pd-25' is built in"),
    bad_fuzzy("  list:\n", "  empty:\n  list:\n", "fuzzy.empty", "wanted a mapping with the key 'kind'"),
    bad_fuzzy("    kind: mamdani\n", "", f"{THREE}.kind", "missing", "  three:"),
    bad_fuzzy("kind: mamdani", "kind: mamdami", f"{THREE}.kind", "did you mean 'mamdani'"),
    bad_fuzzy("    kind: sugeno", "    kind: sugeno\n    aggregation: max-min", f"{LIST}.aggregation", "kind: mamdani"),
    bad_fuzzy("conjunction: product", "conjunktion: product", f"{THREE}.conjunktion", "did you mean 'conjunction'"),
    bad_fuzzy("conjunction: product", "conjunction: prod", f"{THREE}.conjunction", "did you mean 'product'"),
    bad_fuzzy("max-bounded-product", "max-product", f"{THREE}.aggregation", "did you mean 'max-"),
    bad_fuzzy("defuzzification: cog", "defuzzification: centroid", f"{THREE}.defuzzification", "coa, cog"),
    bad_fuzzy("range: [-2, 2]", "range: [2, -2]", f"{THREE}.inputs[0].range", "the lower one first"),
    bad_fuzzy("range: [-2, 2]", "range: 2", f"{THREE}.inputs[0].range", "a list of two numbers"),
    bad_fuzzy("range: [-2, 2]", "range: [-2, two]", f"{THREE}.inputs[0].range[1]", "wanted a number"),
    bad_fuzzy("range: [-2, 2]", "range: [-2, .inf]", f"{THREE}.inputs[0].range[1]", "finite"),
    bad_fuzzy("range: [-2, 2]", "rang: [-2, 2]", f"{THREE}.inputs[0].rang", "did you mean 'range'"),
    bad_fuzzy(NARROW, NARROW.replace("-0.5, -0.1", "-0.1, -0.5"), f"{THREE}.inputs[1].terms.Z", "ascending order"),
    bad_fuzzy(
        NARROW, NARROW.replace("[0, 1, 1]", "[0, 1]"), f"{THREE}.inputs[1].terms.P", "got a list of 2, wanted one"
    ),
    bad_fuzzy(NARROW, NARROW.replace("[0, 1, 1]", "one"), f"{THREE}.inputs[1].terms.P", "3 numbers (a triangle)"),
    bad_fuzzy(NARROW, NARROW.replace("[0, 1, 1]", "[0, true, 1]"), f"{THREE}.inputs[1].terms.P[1]", "wanted a number"),
    bad_fuzzy(NARROW, NARROW.replace("[0, 1, 1]", "[1, 1, 1]"), f"{THREE}.inputs[1].terms.P", "no width"),
    bad_fuzzy(NARROW, "[-1, 0, 1]", f"{THREE}.inputs[1].terms", "a mapping of names to one number"),
    bad_fuzzy(NARROW, NARROW.replace("Z:", '"a b":'), f"{THREE}.inputs[1].terms.'a b'", "letters"),
    bad_fuzzy(WIDE, WIDE.replace("Z: 0", "Z: -3"), f"{THREE}.inputs[0].terms.Z", "from low to high"),
    bad_fuzzy("{low: -1, high: 1}", "{low: -1}", f"{LIST}.inputs[0].terms.low", "no neighbours"),
    bad_fuzzy("      - terms: {low: -1, high: 1}", "      []", f"{LIST}.inputs", "one or two inputs", "      []"),
    bad_fuzzy(
        "{down: [0, -0.5], up: 1}", "{down: [0, 1, 1], up: 1}", f"{LIST}.output.functions.down", "wanted one, or 2"
    ),
    bad_fuzzy("{down: [0, -0.5], up: 1}", "{down: [], up: 1}", f"{LIST}.output.functions.down", "an empty list"),
    bad_fuzzy(
        "      functions: {down",
        "      terms: {down: -1, up: 1}\n      functions: {down",
        f"{LIST}.output.terms",
        "it belongs to kind: mamdani",
    ),
    bad_fuzzy(
        "      - [N, N, Z]\n",
        "",
        f"{THREE}.rules",
        "got 2 rows, wanted 3, one for each term of input 1 (N, Z, P)",
        "- [N, Z, none]",
    ),
    bad_fuzzy("[N, N, Z]", "[N, N]", f"{THREE}.rules[0]", "got 2 consequents, wanted 3"),
    bad_fuzzy("[N, N, Z]", "[N, N, Y]", f"{THREE}.rules[0][2]", "unknown consequent 'Y'"),
    bad_fuzzy("[N, Z, none]", "[N, Z, ~]", f"{THREE}.rules[1][2]", "got nothing, wanted a name"),
    bad_fuzzy("[N, Z, none]", "[N, Z, 0]", f"{THREE}.rules[1][2]", "got 0, wanted a name"),
    bad_fuzzy("- [Z, P, P]", "- {if: [P, P], then: P}", f"{THREE}.rules[2]", "like the first"),
    bad_fuzzy(
        "if: low", "if: lo", f"{LIST}.rules[0]", "unknown term 'lo' of input 1 (did you mean 'low'?)", "- if: lo"
    ),
    bad_fuzzy("if: low", "if: [low, high]", f"{LIST}.rules[0]", "names 2 terms", "- if: [low, high]"),
    bad_fuzzy("if: [high]", "if: [low]", f"{LIST}.rules[1]", "contradicts an earlier rule"),
    bad_fuzzy("then: up", "than: up", f"{LIST}.rules[1].than", "did you mean 'then'"),
    bad_fuzzy("if: [high]", "if: []", f"{LIST}.rules[1].if", "an empty list, wanted names"),
]


def bad_scenario(old: str, new: str, key: str, word: str, on: str | None = None, text: str = SCENARIO) -> Bad:
    """Return one edit of the config with everything a law can have to cope with."""
    return Bad(old, new, key, word, on, text)


TWO_LINK = (
    edited("  structure: corrected\n  constants: printed\n  mismatch:\n    relative: 0.3", "  mismatch: {tolerance: 1}")
    .replace("[0.1, 0.2, 0.3, 0.4, 0.5, 0.6]", "0.1")
    .replace("[1.2, -1.0, 1.0, 1.1, 1.0, 1.0]", "1.2")
)

SCENARIOS = [
    Bad("chain: ideal", "chain: 5", "chain", "got 5, wanted one of ideal, fast, slow, slow-delay,"),
    Bad("chain: ideal", "chain: [fast]", "chain", "got a list of 1, wanted one of ideal, fast,"),
    Bad(
        "chain: ideal",
        "chain: {}\nmeasurement_delay: 0.004",
        "measurement_delay",
        "wanted it in chain",
        "measurement_delay:",
    ),
    bad_scenario("encoder_noise: 0.0001", "encoder_noise: -0.0001", "chain.encoder_noise", "at least 0"),
    bad_scenario("encoder_noise: 0.0001", "encoder_noise: [0, 1]", "chain.encoder_noise", "wanted a number [rad]"),
    bad_scenario("quantisation: 0.0002", "quantization: 0.0002", "chain.quantization", "did you mean 'quantisation'"),
    bad_scenario("quantisation: 0.0002", "quantisation: -1", "chain.quantisation", "at least 0"),
    bad_scenario("velocity: differentiated", "velocity: filtered", "chain.velocity", "exact, differentiated"),
    bad_scenario(
        "velocity: differentiated", "velocity: exact", "chain.velocity_filter", "no effect", "velocity_filter"
    ),
    bad_scenario("velocity_filter: 300", "velocity_filter: 0", "chain.velocity_filter", "more than 0"),
    bad_scenario("measurement_delay: 0.004", "measurement_delay: 0.003", "chain.measurement_delay", "nearest is 0.004"),
    bad_scenario(
        "measurement_delay: 0.004", "measurement_delay: 4", "chain.measurement_delay", "less than run.duration, 4 s"
    ),
    bad_scenario("measurement_delay: 0.004", "measurement_delay: -0.004", "chain.measurement_delay", "at least 0"),
    bad_scenario("actuator_lag: 0.003", "torque_delay: 0.0015", "chain.torque_delay", "multiple of plant.timestep"),
    bad_scenario("actuator_lag: 0.003", "jitter: 0.0005", "chain.jitter", "at least plant.timestep, 0.001 s, or 0"),
    bad_scenario("actuator_lag: 0.003", "jitter: 0.1", "chain.jitter", "at most run.control_period"),
    bad_scenario("actuator_lag: 0.003", "velocity_noise: 1", "chain.velocity_noise", "no effect", "velocity_noise:"),
    bad_scenario("actuator_lag: 0.003", "torque_rate: [1, 2]", "chain.torque_rate", "wanted one number or 6"),
    bad_scenario("actuator_lag: 0.003", "torque_speed: {corner: 2, no_load: 2}", "chain.torque_speed.no_load", "more"),
    bad_scenario("actuator_lag: 0.003", "current_loop: {frequency: 0}", "chain.current_loop.frequency", "more than 0"),
    bad_scenario(
        "velocity: differentiated\n  velocity_filter: 300",
        "velocity: kalman",
        "chain.kalman_acceleration",
        "missing",
        "chain:",
    ),
    bad_scenario("actuator_lag: 0.003", "actuator_lag: .inf", "chain.actuator_lag", "finite"),
    bad_scenario("actuator_lag: 0.003", "actuator_lag: 0.003\n  seed: 3", "chain.seed", "in run"),
]

FILMS = [
    Bad("  quality: pretty", "  quality: best", "video.quality", "one of fast, pretty"),
    Bad("  size: [320, 240]", "  size: [321, 240]", "video.size[0]", "an even number"),
    Bad("  size: [320, 240]", "  size: [320, 80]", "video.size[1]", "at least 160"),
    Bad("  size: [320, 240]", "  size: 320x240", "video.size", "width and height, as [640, 480]"),
    Bad("  size: [320, 240]", "  size: [320]", "video.size", "width and height, as [640, 480]"),
    Bad("  speed: 0.5", "  speed: 0", "video.speed", "at least 0.001"),
    Bad("  camera: side", "  camera: sied", "video.camera", "no camera 'sied' (did you mean 'side'?)"),
    Bad("  exaggerate: 20", "  exaggerate: 0", "video.exaggerate", "at least 1"),
    Bad("  ears: [conventional,", "  ears: [convential,", "video.ears", "(did you mean 'conventional'?)"),
    Bad("  ears: [conventional, conventional]", "  ears: conventional", "video.ears", "two names of controllers"),
    Bad("  speed: 0.5\n", "  speed: 0.1\n", "video.speed", "wanted 0.25 to 4 with sound"),
    Bad("  camera: side", "  camera: 2", "video.camera", "wanted text"),
    Bad(
        "chain: ideal",
        "chain: ideal\ncamera: overview",
        "camera",
        "wanted it in video",
        "camera: overview",
    ),
]

BAD = UNKNOWN_KEYS + MISSING_KEYS + WRONG_TYPES + WRONG_SHAPES + BAD_NUMBERS + BAD_NAMES + CONTRADICTIONS + BAD_YAML
BAD += FUZZY_SYSTEMS + SCENARIOS + FILMS
