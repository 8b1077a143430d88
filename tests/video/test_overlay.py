"""What is written and drawn around the views is where and as large as it must be."""

from functools import partial

import numpy as np
import pytest
from PIL import Image, ImageDraw

from torquebench.errors import VideoError
from torquebench.laws.law import law_names
from torquebench.scene.look import Scene
from torquebench.sim.trajectory import Outcome, Trajectory
from torquebench.video.job import SEPARATOR, Footage, Shot
from torquebench.video.layout import layout, timeline
from torquebench.video.overlay import ALARM, JOINTS, PLAIN, Overlay, layout_for
from torquebench.video.paint import FINE, band, fill, fit, font, text_width, write

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
    over = Overlay(Footage("title", "arm", 0.001, 0.5, shots), runs, size, timeline(0.5, 1.0, 0.001), arm)
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


def test_text_is_aligned_and_shortened_to_fit():
    """Left, centred and right text is where it must be; a text too long ends in an ellipsis and fits."""
    width = font(12).getlength("RMSE 0.5 mrad") / FINE
    for align, left in (("left", 100), ("middle", 100 - width / 2), ("right", 100 - width)):
        text = partial(write, x=100, y=20, text="RMSE 0.5 mrad", size=12, colour=(0, 0, 0), align=align)
        picture = painted_on(300, 30, text, (255, 255, 255))
        columns = np.flatnonzero((picture < 128).any(axis=(0, 2)))
        assert abs(columns[0] - left) < 3
        assert abs(columns[-1] - (left + width)) < 3
    shorter = fit("a-controller-with-a-long-name", 12, 80)
    assert shorter.endswith("…")
    assert font(12).getlength(shorter) <= 80 * FINE
    assert fit("short", 12, 80) == "short"


@pytest.mark.parametrize(("count", "size"), [(1, (640, 480)), (3, (640, 480)), (4, (640, 480)), (6, (1280, 720))])
def test_every_law_is_named_whole(count, size):
    """Figures and law are cut nowhere, whatever law of the package it is; they take one line where there is room."""
    widest = "RMSE 0.00123 mrad", "HF 0.00123 %"
    for law in law_names():
        note = SEPARATOR.join([*widest, law])
        where, notes = layout_for([Shot("name", note, "")] * count, size)
        assert where == layout(count, *size, len(notes.lines[0]))
        width, height = where.panels[0].title.width, PLAIN * where.unit
        assert 0.79 * height < notes.height <= height
        for lines in notes.lines:
            assert SEPARATOR.join(lines) == note
            assert all(fit(line, notes.height, width) == line for line in lines)
            assert len(lines) == 1 or text_width(note, height) > width
        assert count > 1 or where == layout(1, *size)


def test_each_line_of_a_note_is_seen():
    """In three panels the law has a line of its own: in the first panel's title are three rows of ink, apart."""
    over, where = overlay(*[run()] * 3, notes=("RMSE 0.123 mrad", "HF 30.1 %", "fuzzy-linear-band-smc"))
    title = part(frame(over, where, 0), where.panels[0].title)
    ink = (title.min(axis=2) < 240).any(axis=1)
    assert np.count_nonzero(np.diff(ink.astype(int)) == 1) == 3
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
    box = where.panels[0].traces
    upper = part(frame(over, where, 11), box._replace(height=box.height // 2))[13:]
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
    over, where = overlay(run(200, outcome=Outcome.DIVERGED), run())
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
    assert columns[0] > 0.7 * where.header.width
