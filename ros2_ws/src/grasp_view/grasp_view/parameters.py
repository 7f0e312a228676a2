"""Every parameter of `grasp_view`: name, default, range, and what it means."""

from __future__ import annotations

from dataclasses import dataclass

Value = bool | int | float | str | list[float]


@dataclass(frozen=True)
class Parameter:
    """One declared parameter; `fixed` ones are read at start only."""

    name: str
    default: Value
    description: str
    lowest: float | None = None
    highest: float | None = None
    fixed: bool = True


PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        'host',
        '127.0.0.1',
        'address to serve on; 0.0.0.0 lets a tablet in, and everybody else on that network',
    ),
    Parameter('port', 8080, 'TCP port of the page', 1024, 65535),
    Parameter('rate', 20.0, 'pictures sent to the browsers (Hz)', 1.0, 60.0),
    Parameter('history', 60.0, 'kept for the time slider and the plots (s)', 5.0, 600.0),
    Parameter(
        'hand_frame', 'hand_base', "frame id of the hand; every other counts as the object's",
        fixed=False,
    ),
    Parameter(
        'object_pose',
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0],
        'object in the hand frame until object_pose comes by topic: x y z (m) qx qy qz qw',
        fixed=False,
    ),
    Parameter('replay_node', 'replay', 'name of the replay node that the page steers'),
    Parameter(
        'what_if',
        False,
        'no hand: place fingers in the page, solved by a deformation process of its own',
    ),
    Parameter('object', 'tennis_ball', 'object of what_if at start: name or object file'),
)  # fmt: skip


def usage() -> str:
    """What `grasp_view --help` prints: every parameter with its unit, range and default."""
    lines = [
        'usage: grasp_view [-h] [--ros-args -p NAME:=VALUE ...]',
        '',
        'A live page of a grasp in the browser. SI units.',
        '',
        'parameters:',
    ]
    for parameter in PARAMETERS:
        lines.append(f'  {parameter.name} (default {parameter.default!r})')
        lines.append(f'      {parameter.description}{_limits(parameter)}')
    return '\n'.join(lines)


def _limits(parameter: Parameter) -> str:
    if parameter.lowest is not None and parameter.highest is not None:
        return f' ({parameter.lowest:g} to {parameter.highest:g})'
    return ''
