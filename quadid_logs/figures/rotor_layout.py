"""The airframe from above, so that a wrong motor map is seen at a glance."""

from __future__ import annotations

import numpy as np

from quadid_logs.data.result import Result
from quadid_logs.data.torque import TorqueModel
from quadid_logs.figures.spec import Axis, Curve, Figure, Label, LeftOut, Mark, Panel

#: Radius of a rotor disc, of the one below it, of the nose arrow, and the longest side of an arrow head, in
#: longest arms.
_DISC, _LOWER_DISC, _NOSE, _HEAD = 0.3, 0.24, 0.22, 0.1
#: The disc's arrow covers this part of a turn, so that its direction is seen.
_TURN = 0.85 * 2.0 * np.pi
#: Rotors closer than this, in longest arms, sit above each other.
_SAME_PLACE = 0.05
_SPIN = {
    1.0: ("counter-clockwise", "series-1"),
    -1.0: ("clockwise", "series-2"),
    0.0: ("spin unknown", "muted"),
}


def airframe_from_above(result: Result) -> Figure | LeftOut:
    """Draw arms, rotors with their numbers, and the direction of their spin."""
    title = "The airframe from above"
    model = result.log.torque
    if model is None or not model.n_rotors:
        return LeftOut(key="airframe", title=title, reason="The log does not say where the rotors are.")
    reach = float(np.hypot(model.position[:, 0], model.position[:, 1]).max())
    if not (np.isfinite(reach) and reach > 0.0):
        return LeftOut(key="airframe", title=title, reason="The rotors have no distance from the centre.")
    curves, labels = _rotors(model, reach)
    unit = "m" if model.position_unit == "m" else "arm lengths"
    edge = reach * (1.0 + 1.6 * _DISC)
    # The arrow that points to the front.
    size = _NOSE * reach
    x = size * np.array([0.0, 0.0, np.nan, -0.3, 0.0, 0.3])
    y = size * np.array([-0.6, 1.0, np.nan, 0.6, 1.0, 0.6])
    # A line from the centre to the edge of each disc, all in one series.
    length = np.hypot(model.position[:, 0], model.position[:, 1])
    shown = np.maximum(length - _DISC * length.max(), 0.0) / np.where(length > 0.0, length, 1.0)
    forward, right = model.position[:, 0] * shown, model.position[:, 1] * shown
    gap, zero = np.full_like(right, np.nan), np.zeros_like(right)
    across, up = (np.column_stack([zero, end, gap]).ravel() for end in (right, forward))
    panel = Panel(
        title=model.frame,
        x=Axis(label="to the right", unit=unit),
        y=Axis(label="to the front", unit=unit, low=-edge, high=edge),
        curves=(
            Curve(label="arm", x=across, y=up, role="muted"),
            Curve(label="nose", x=x, y=y, role="ink"),
            *curves,
        ),
        labels=labels,
        equal=True,
        height=1.7,
    )
    # Say what the numbers are and where the drawing comes from.
    parts = [f"Seen from above, nose up, with the number of each motor. Source: {model.frame_source}."]
    if model.channels:
        outputs = ", ".join(f"{motor}: {channel}" for motor, channel in enumerate(model.channels, start=1))
        parts.append(f"Motor and output: {outputs} ({model.channel_source}).")
    if model.position_unit != "m":
        parts.append("Only the shape is known, not the length of the arms.")
    parts.append("If this is not your vehicle, every torque below is wrong.")
    return Figure(key="airframe", title=title, caption=" ".join(parts), panels=(panel,), small=True)


def _rotors(model: TorqueModel, reach: float) -> tuple[list[Curve], tuple[Label, ...]]:
    """Return the discs with their arrows, a smaller dashed one for the rotor below, and the numbers."""
    places: dict[tuple[int, int], list[int]] = {}
    for number in range(model.n_rotors):
        forward, right = (float(value) / (_SAME_PLACE * reach) for value in model.position[number, :2])
        places.setdefault((round(forward), round(right)), []).append(number)
    curves, labels = [], []
    for numbers in places.values():
        upper_first = sorted(numbers, key=lambda number: float(model.position[number, 2]))
        for layer, number in enumerate(upper_first):
            word, role = _SPIN[float(np.sign(model.spin[number]))]
            radius = reach * (_DISC if layer == 0 else _LOWER_DISC)
            forward, right = (float(value) for value in model.position[number, :2])
            # A nearly full circle that ends in an arrow head, as one line with a gap
            spin = float(np.sign(model.spin[number]))
            head = _HEAD * reach
            angle = np.linspace(0.0, _TURN if spin else 2.0 * np.pi, 60) * (spin or 1.0) + 0.5 * np.pi
            around = np.column_stack([right + radius * np.cos(angle), forward + radius * np.sin(angle)])
            if spin:
                ahead = angle[-1] + spin * 0.5 * np.pi
                barbs = [
                    around[-1] - head * np.array([np.cos(ahead + turn), np.sin(ahead + turn)])
                    for turn in (0.5, -0.5)
                ]
                around = np.vstack([around, [[np.nan, np.nan]], barbs[0], around[-1], barbs[1]])
            mark: Mark = "line" if layer == 0 else "dashed"
            curves.append(Curve(label=word, x=around[:, 0], y=around[:, 1], role=role, mark=mark))
        forward, right = (float(value) for value in model.position[upper_first[0], :2])
        text = " / ".join(str(number + 1) for number in upper_first)
        labels.append(Label(text=text, x=right, y=forward, role="ink"))
    return curves, tuple(labels)
