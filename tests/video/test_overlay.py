"""What is written and drawn around the views is where and as large as it must be."""

from functools import partial

import numpy as np
import pytest
from PIL import Image, ImageDraw

from torquebench.errors import VideoError
from torquebench.experiment.schema import Video
from torquebench.laws.law import law_names
from torquebench.report.tables import without_common_words
from torquebench.scene.look import Scene
from torquebench.sim.trajectory import Outcome, Trajectory
from torquebench.video.job import SEPARATOR, Footage, Shot
from torquebench.video.layout import layout, timeline
from torquebench.video.overlay import (
    ALARM,
    JOINTS,
    LARGE,
    PLAIN,
    Overlay,
    layout_for,
    titles,
)
from torquebench.video.paint import FINE, band, fill, font, text_width, wrap, write

TAU_MAX = np.array([10.0, 20.0])


def run(n_steps=500, tau=(0.0, 0.0), error=0.0, s=np.nan, outcome=Outcome.COMPLETED):
    """A run of two joints at 1 kHz in which nothing changes."""
    t = np.arange(n_steps) * 0.001
    zero = np.zeros((n_steps, 2))
    torque = zero + np.array(tau)
    return Trajectory(
        t=t,
        q=zero - error,
        qd=zero,
        q_meas=zero,
        qd_meas=zero,
        q_ref=zero.copy(),
        qd_ref=zero,
        qdd_ref=zero,
        s=zero + s,
        tau_law=torque,
        tau=torque,
        tau_applied=torque,
        outcome=outcome,
    )


def overlay(*runs, notes=("note",), size=(640, 480)):
    """An overlay of half a second of runs, and its layout."""
    shots = tuple(Shot(f"law-{i}", SEPARATOR.join(notes), "") for i in range(len(runs)))
    arm = Scene(None, (), 1.0, ["a", "b"], "rad", TAU_MAX)
    over = Overlay(Footage("title", "arm", 0.001, 0.5, shots), runs, Video(size=size), timeline(0.5, 1.0, 0.001), arm)
    return over, over.where


def frame(over, where, i):
    """A frame around grey views."""
    view = where.panels[0].view
    grey = Image.new("RGB", (FINE * view.width, FINE * view.height), (128, 128, 128))
    return np.asarray(over.draw(i, [grey] * len(where.panels)))


def part(pixels, box):
    """The pixels of a box."""
    return pixels[box.y : box.y + box.height, box.x : box.x + box.width].astype(int)


def painted(pixels, colour, tolerance=40):
    """Which pixels have a colour."""
    return np.abs(pixels - np.array(colour)).max(axis=2) < tolerance


def boxes(panel):
    """All parts of a panel."""
    return [panel.title, panel.view, panel.bars, *panel.traces]


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (320, 240), (1920, 1080), (480, 960)])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 9, 12])
@pytest.mark.parametrize("lines", [2, 5])
def test_panels_share_the_frame_without_overlap(count, size, lines):
    """Views, bars and traces of all panels lie inside the frame, below the header, and no two of them overlap."""
    title = 6.0 + 14.0 * lines
    if count > {(320, 240): 2}.get(size, 12):
        with pytest.raises(VideoError, match="do not fit"):
            layout(count, size, 6, lambda width, unit: title)
        return
    where = layout(count, size, 6, lambda width, unit: title)
    taken = np.zeros((size[1], size[0]), int)
    for panel in where.panels:
        for box in boxes(panel):
            assert min(box.width, box.height) > 0
            assert box.x + box.width <= size[0]
            assert box.y + box.height <= size[1]
            assert box.y >= where.header.height
            taken[box.y : box.y + box.height, box.x : box.x + box.width] += 1
    assert taken.max() == 1
    assert len({(panel.view.width, panel.view.height) for panel in where.panels}) == 1


@pytest.mark.parametrize(
    ("count", "columns", "rows"), [(1, 1, 1), (2, 2, 1), (3, 3, 1), (4, 2, 2), (6, 3, 2), (9, 3, 3)]
)
def test_panels_form_a_grid(count, columns, rows):
    """In 1280 x 720 the usual numbers of controllers stand in the grid that one expects, with readable letters."""
    where = layout(count, (1280, 720), 6, lambda width, unit: 34.0)
    assert len({panel.view.x for panel in where.panels}) == columns
    assert len({panel.view.y for panel in where.panels}) == rows
    assert where.unit > 1.0
    assert all(len(panel.traces) == 2 for panel in where.panels)


def painted_on(width, height, paint, colour=(0, 0, 0)):
    """What a function draws on a picture of a colour, as it is shown."""
    image = Image.new("RGB", (FINE * width, FINE * height), colour)
    paint(ImageDraw.Draw(image, "RGBA"))
    return np.asarray(image.reduce(FINE)).astype(int)


def test_filled_boxes_have_their_area_to_half_a_pixel():
    """A box from 2.5 to 7.5 by 1.5 to 4 covers 5 x 2.5 pixels' worth, cut off at the picture's edge."""
    for x0, x1, area in ((2.5, 7.5, 5.0 * 2.5), (-3.0, 2.0, 2.0 * 2.5), (9.5, 30.0, 0.5 * 2.5), (20.0, 30.0, 0.0)):
        for alpha in (255, 51):
            picture = painted_on(10, 6, partial(fill, x0=x0, y0=1.5, x1=x1, y1=4.0, colour=(200, 200, 200, alpha)))
            assert picture[:, :, 0].sum() / 200.0 * 255 / alpha == pytest.approx(area, abs=0.1)


def test_text_is_aligned():
    """Left, centred and right text is where it must be."""
    width = font(12).getlength("RMSE 0.5 mrad") / FINE
    for align, left in (("left", 100), ("middle", 100 - width / 2), ("right", 100 - width)):
        text = partial(write, x=100, y=20, text="RMSE 0.5 mrad", size=12, colour=(0, 0, 0), align=align)
        picture = painted_on(300, 30, text, (255, 255, 255))
        columns = np.flatnonzero((picture < 128).any(axis=(0, 2)))
        assert abs(columns[0] - left) < 3
        assert abs(columns[-1] - (left + width)) < 3


@pytest.mark.parametrize("width", [60, 110, 400])
def test_text_that_is_wrapped_is_whole(width):
    """Every letter is there, each line fits, and lines end at spaces or hyphens where that is possible."""
    name = "a-controller-with-a-long-name"
    lines = wrap(name, 12, width)
    assert "".join(lines) == name
    assert all(font(12).getlength(line) <= FINE * width for line in lines)
    assert all(line.endswith("-") for line in lines[:-1]) or width == 60
    assert wrap("one-two three-four", 12, text_width("three-four", 12) + 1) == ["one-two", "three-four"]
    assert "".join(wrap("x" * 64, 12, width)) == "x" * 64


@pytest.mark.parametrize(
    ("count", "size"),
    [(1, (640, 480)), (3, (640, 480)), (4, (640, 480)), (6, (1280, 720)), (9, (1280, 720)), (9, (640, 480))],
)
def test_every_controller_and_its_law_are_named_whole(count, size):
    """Name, figures and law are cut nowhere, whatever law of the package it is; figures stay with their units."""
    figures = "RMSE 0.00123 mrad", "chattering 0.00123 %"
    for law in law_names():
        shots = [Shot(f"{law}-variant", SEPARATOR.join([*figures, law]), "")] * count
        where = layout_for(shots, size, 6)
        width = where.panels[0].title.width
        for name, note in titles(shots, width, where.unit):
            assert "".join(name) == f"{law}-variant"
            text = " ".join(note).replace("\xa0", " ")
            assert all(part in text for part in figures)
            assert law in text.replace("- ", "-")
            assert all(text_width(line, LARGE * where.unit, bold=True) <= width for line in name)
            assert all(text_width(line, PLAIN * where.unit) <= width for line in note)


def test_each_line_of_a_note_is_seen():
    """In three panels the law has a line of its own: below the stripe of its colour are three rows of ink, apart."""
    over, where = overlay(*[run()] * 3, notes=("RMSE 0.123 mrad", "chattering 30.1 %", "fuzzy-linear-band-smc"))
    title = part(frame(over, where, 0), where.panels[0].title)
    ink = (title.min(axis=2) < 240).any(axis=1)
    assert np.count_nonzero(np.diff(ink.astype(int)) == 1) == 4
    assert not ink[-1]


def test_a_curve_covers_its_band():
    """From row 2.5 to row 7.5: rows 3 to 6 whole, half a row beyond; nothing where it is NaN."""
    edges = np.array([[2.5] * 4 + [np.nan] * 4, [7.0] * 4 + [np.nan] * 4])
    cover = painted_on(6, 12, lambda draw: band(draw, 2, edges, (255, 255, 255)))[:, :, 0] / 255
    assert cover[:, 1].round(1).tolist() == cover[:, 2].round(1).tolist() == [0, 0, 0.5, 1, 1, 1, 1, 0.5, 0, 0, 0, 0]
    assert not cover[:, [0, 3, 4, 5]].any()


def test_a_curve_that_jumps_has_no_gap():
    """Where neighbouring columns lie apart, every row between them is covered."""
    over, where = overlay(run(error=np.where(np.arange(500)[:, None] < 80, 1e-3, -1e-3) * [0, 1]))
    upper = part(frame(over, where, 11), where.panels[0].traces[0])
    hit = upper[:, :, 1] - upper[:, :, 2] > 20  # the second joint's colour has no blue
    rows = np.flatnonzero(hit.any(axis=1))
    assert np.ptp(rows) > 20
    assert np.count_nonzero(hit.any(axis=1)) == np.ptp(rows) + 1


def test_bars_are_as_long_as_torque_over_limit():
    """Half the limit fills half of a bar's side, on the side of its sign; twice the torque is twice as long."""
    lengths = {}
    for tau in ((5.0, -5.0), (2.5, -10.0)):
        over, where = overlay(run(tau=tau))
        pixels = part(frame(over, where, 3), where.panels[0].bars)
        for joint in range(2):
            hit = painted(pixels, JOINTS[joint])[:, 12:]  # right of the joints' names
            columns = np.flatnonzero(hit.sum(axis=0) > 4)
            lengths[joint, tau[joint]] = (columns[0], columns[-1] + 1)
    middle = lengths[0, 5.0][0]
    assert abs(lengths[1, -5.0][1] - middle) <= 3  # the line in the middle is between them
    assert lengths[0, 5.0][1] > middle > lengths[1, -5.0][0]
    size = {key: end - start for key, (start, end) in lengths.items()}
    assert size[0, 5.0] == pytest.approx(2 * size[0, 2.5], abs=3)
    assert size[1, -10.0] == pytest.approx(2 * size[1, -5.0], abs=3)
    assert size[0, 5.0] == pytest.approx(size[1, -10.0], abs=3)  # both half of their limits


@pytest.mark.parametrize(("tau", "alarms"), [((9.99, 0.0), False), ((10.0, 0.0), True), ((-10.0, 20.0), True)])
def test_a_limit_that_is_reached_turns_red(tau, alarms):
    """Saturated joints are marked in red, others not."""
    over, where = overlay(run(tau=tau))
    assert painted(part(frame(over, where, 3), where.panels[0].bars), ALARM, 12).any() == alarms


def test_traces_share_one_scale_and_grow_with_time():
    """The larger of two constant errors reaches the edge, half of it half way; the curve grows with each frame."""
    over, where = overlay(run(error=2e-3), run(error=1e-3))
    offsets, widths = [], []
    for i in (4, 8):
        pixels = frame(over, where, i)
        for panel in where.panels:
            upper = part(pixels, panel.traces[0])
            hit = upper[:, :, 2] < 150  # the curve's colour has little blue
            rows, columns = np.nonzero(hit)
            offsets.append(rows.mean())
            widths.append(np.ptp(columns) + 1)
    middle = (offsets[1] - offsets[0]) * 2 + offsets[0]  # where zero must be
    assert offsets[0] < offsets[1] < middle == pytest.approx(where.panels[0].traces[0].height / 2, abs=2)
    assert widths[2] == pytest.approx(2 * widths[0], abs=1)
    assert widths[0] == widths[1]


def test_a_failed_run_says_so_from_its_end_on():
    """The banner of a run that ended at 0.2 s is there from frame 5 on, not before; its bars and curves have ended."""
    over, where = overlay(run(200, outcome=Outcome.DIVERGED), run())
    red = [painted(part(frame(over, where, i), where.panels[0].view), ALARM).any() for i in (0, 4, 5, 11)]
    assert red == [False, False, True, True]
    assert not painted(part(frame(over, where, 11), where.panels[1].view), ALARM).any()


def test_time_is_written_and_moves():
    """The header of two frames differs, at its right end only."""
    over, where = overlay(run())
    a, b = (part(frame(over, where, i), where.header) for i in (0, 10))
    columns = np.flatnonzero((a != b).any(axis=(0, 2)))
    assert columns.size
    assert columns[0] > 0.7 * where.header.width


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (["r_elbow_flex_joint", "r_wrist_joint"], ["elbow_flex", "wrist"]),
        (["joint_1", "joint_2"], ["joint_1", "joint_2"]),
        (["iiwa_joint_1", "iiwa_joint_2"], ["joint_1", "joint_2"]),
        (["robot0:pan_joint", "robot0:lift_joint"], ["pan", "lift"]),
        (["arm/panda_joint1", "arm/panda_joint2"], ["joint1", "joint2"]),
        (["elbow_joint"], ["elbow_joint"]),
        (["joint", "elbow_joint"], ["joint", "elbow_joint"]),
        ([], []),
    ],
)
def test_names_of_joints_without_their_common_words(names, short):
    """What all begin or end with tells nothing apart; something that begins with a letter stays of each."""
    assert without_common_words(names) == short
