"""What is written and drawn around the views is where and as large as it must be."""

import numpy as np
import pytest
from PIL import Image

from torquebench.errors import VideoError
from torquebench.laws.law import law_names
from torquebench.sim.trajectory import Outcome, Trajectory
from torquebench.video.job import SEPARATOR, Shot
from torquebench.video.layout import layout, timeline
from torquebench.video.overlay import ALARM, JOINTS, PLAIN, Overlay, layout_for, note_lines
from torquebench.video.paint import band, fill, fit, font, write

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


def overlay(*runs, endings=None, size=(640, 480)):
    """An overlay of runs, and its layout."""
    where = layout(len(runs), *size)
    endings = endings or [""] * len(runs)
    shots = [Shot(f"law-{i}", "note", end, "") for i, end in enumerate(endings)]
    return around(shots, runs, where), where


def around(shots, runs, where):
    """An overlay of half a second."""
    return Overlay(shots, runs, where, timeline(0.5, 1.0, 0.001), "title", ["a", "b"], ["rad", "rad"], TAU_MAX)


def frame(over, where, i):
    """A frame around grey views."""
    view = where.panels[0].view
    grey = Image.new("RGB", (view.width, view.height), (128, 128, 128))
    return np.asarray(over.draw(i, [grey] * len(where.panels)))


def part(pixels, box):
    """The pixels of a box."""
    return pixels[box.y : box.y + box.height, box.x : box.x + box.width].astype(int)


def painted(pixels, colour, tolerance=40):
    """Which pixels have a colour."""
    return np.abs(pixels - np.array(colour)).max(axis=2) < tolerance


@pytest.mark.parametrize("size", [(640, 480), (1280, 720), (320, 240), (1920, 1080)])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize("notes", [1, 3])
def test_panels_share_the_frame_without_overlap(count, size, notes):
    """Views, bars and traces of all panels lie inside the frame, below the header, and no two of them overlap."""
    if size == (320, 240) and count > 2:
        with pytest.raises(VideoError, match="do not fit"):
            layout(count, *size, notes)
        return
    where = layout(count, *size, notes)
    taken = np.zeros((size[1], size[0]), int)
    for panel in where.panels:
        for box in panel:
            assert min(box.width, box.height) > 0
            assert box.x + box.width <= size[0]
            assert box.y + box.height <= size[1]
            assert box.y >= where.header.height
            taken[box.y : box.y + box.height, box.x : box.x + box.width] += 1
    assert taken.max() == 1
    assert len({(panel.view.width, panel.view.height) for panel in where.panels}) == 1


def test_two_controllers_are_side_by_side():
    """In a frame of 640 x 480 two panels are next to each other, at the same height."""
    a, b = layout(2, 640, 480).panels
    assert a.view.y == b.view.y
    assert a.view.x + a.view.width <= b.view.x


def test_filled_boxes_have_their_area_to_a_fraction_of_a_pixel():
    """A box from 2.25 to 7.5 by 1.5 to 4 covers 5.25 x 2.5 pixels' worth, cut off at the picture's edge."""
    for x0, x1, area in ((2.25, 7.5, 5.25 * 2.5), (-3.0, 2.0, 2.0 * 2.5), (9.5, 30.0, 0.5 * 2.5), (20.0, 30.0, 0.0)):
        image = Image.new("RGB", (10, 6))
        fill(image, x0, 1.5, x1, 4.0, (200, 200, 200))
        assert np.asarray(image)[:, :, 0].sum() / 200.0 == pytest.approx(area, abs=0.05)


def test_text_is_aligned_and_shortened_to_fit():
    """Left, centred and right text is where it must be; a text too long ends in an ellipsis and fits."""
    width = font(12).getlength("RMSE 0.5 mrad")
    for align, left in (("left", 100), ("middle", 100 - width / 2), ("right", 100 - width)):
        image = Image.new("RGB", (300, 30), (255, 255, 255))
        write(image, 100, 20, "RMSE 0.5 mrad", 12, (0, 0, 0), align=align)
        columns = np.flatnonzero((np.asarray(image) < 128).any(axis=(0, 2)))
        assert abs(columns[0] - left) < 3
        assert abs(columns[-1] - (left + width)) < 3
    shorter = fit("a-controller-with-a-long-name", 12, 80)
    assert shorter.endswith("…")
    assert font(12).getlength(shorter) <= 80
    assert fit("short", 12, 80) == "short"


@pytest.mark.parametrize(("count", "size"), [(1, (640, 480)), (3, (640, 480)), (4, (640, 480)), (6, (1280, 720))])
def test_every_law_is_named_whole(count, size):
    """Figures and law are cut nowhere, whatever law of the package it is; they take one line where there is room."""
    widest = "RMSE 0.00123 mrad", "HF 0.00123 %"
    for law in law_names():
        shots = [Shot("name", SEPARATOR.join([*widest, law]), "", "")] * count
        where = layout_for(shots, size)
        lines = note_lines(shots[0], where)
        assert "".join(lines).replace(" ", "") == shots[0].note.replace(" ", "")
        assert len(lines) == where.notes
        width = font(round(PLAIN * where.unit)).getlength
        assert all(width(line) <= where.panels[0].title.width for line in lines)
        assert len(lines) == 1 or width(shots[0].note) > where.panels[0].title.width
        assert count > 1 or where == layout(1, *size)


def test_each_line_of_a_note_is_seen():
    """In three panels the law has a line of its own: in the first panel's title are three rows of ink, apart."""
    shots = [Shot("name", SEPARATOR.join(["RMSE 0.123 mrad", "HF 30.1 %", "fuzzy-linear-band-smc"]), "", "")] * 3
    where = layout_for(shots, (640, 480))
    title = part(frame(around(shots, [run()] * 3, where), where, 0), where.panels[0].title)
    ink = (title.min(axis=2) < 240).any(axis=1)
    assert np.count_nonzero(np.diff(ink.astype(int)) == 1) == 3
    assert not ink[-1]


def test_a_curve_covers_its_envelope():
    """From row 3 to row 7 with a pen of half a pixel: rows 3 to 6 whole, half a row beyond; nothing where it is NaN."""
    image = Image.new("RGB", (6, 12))
    nan = [np.nan, np.nan]
    band(image, 1, 0, 12, np.array([3.0, 3.0, *nan]), np.array([7.0, 7.0, *nan]), 0.5, (255, 255, 255))
    cover = np.asarray(image)[:, :, 0] / 255
    assert cover[:, 1].round(1).tolist() == cover[:, 2].round(1).tolist() == [0, 0, 0.5, 1, 1, 1, 1, 0.5, 0, 0, 0, 0]
    assert not cover[:, [0, 3, 4, 5]].any()


def test_a_curve_that_jumps_has_no_gap():
    """Where neighbouring columns lie apart, every row between them is covered."""
    image = Image.new("RGB", (4, 40))
    band(image, 0, 0, 40, np.array([5.0, 5.0, 5.0, 30.0]), np.array([5.0, 5.0, 30.0, 30.0]), 0.5, (255, 255, 255))
    assert (np.asarray(image)[5:30, :, 0].max(axis=1) > 120).all()


def test_bars_are_as_long_as_torque_over_limit():
    """Half the limit fills half of a bar's side, on the side of its sign; twice the torque is twice as long."""
    lengths = {}
    for tau in ((5.0, -5.0), (2.5, -10.0)):
        over, where = overlay(run(tau=tau))
        pixels = part(frame(over, where, 3), where.panels[0].bars)
        for joint in range(2):
            hit = painted(pixels, JOINTS[joint])[:, 80:]  # right of the joints' names
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
            box = panel.traces
            upper = part(pixels, box._replace(height=box.height // 2))
            upper[:13] = 255  # without the label
            hit = upper[:, :, 2] < 150  # the curve's colour has little blue
            rows, columns = np.nonzero(hit)
            offsets.append(rows.mean())
            widths.append(np.ptp(columns) + 1)
    label = where.panels[0].traces.height // 2
    middle = (offsets[1] - offsets[0]) * 2 + offsets[0]  # where zero must be
    assert offsets[0] < offsets[1] < middle < label
    assert widths[2] == pytest.approx(2 * widths[0], abs=1)
    assert widths[0] == widths[1]


def test_a_failed_run_says_so_from_its_end_on():
    """The banner of a run that ended at 0.2 s is there from frame 5 on, not before; its bars and curves have ended."""
    over, where = overlay(run(200, outcome=Outcome.DIVERGED), run(), endings=["diverged at 0.199 s", ""])
    red = [painted(part(frame(over, where, i), where.panels[0].view), ALARM).any() for i in (0, 4, 5, 11)]
    assert red == [False, False, True, True]
    assert not painted(part(frame(over, where, 11), where.panels[1].view), ALARM).any()


def test_a_law_without_sliding_variable_has_no_curve():
    """NaN all the way draws no curve but says that there is none; frames with and without differ there only."""
    over, where = overlay(run(s=0.1), run())
    box = where.panels[0].traces
    lower = box._replace(y=box.y + box.height // 2, height=box.height // 2)
    other = lower._replace(x=lower.x + where.panels[1].traces.x - box.x)
    pixels = frame(over, where, 8)
    r, b = (part(pixels, lower)[:, :, i] for i in (0, 2))
    assert (r - b > 60).any()
    r, b = (part(pixels, other)[:, :, i] for i in (0, 2))
    assert not (r - b > 60).any()


def test_time_is_written_and_moves():
    """The header of two frames differs, at its right end only."""
    over, where = overlay(run())
    a, b = (part(frame(over, where, i), where.header) for i in (0, 10))
    columns = np.flatnonzero((a != b).any(axis=(0, 2)))
    assert columns.size
    assert columns[0] > 0.7 * where.width
