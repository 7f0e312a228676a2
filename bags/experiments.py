# SPDX-License-Identifier: Apache-2.0
"""The recordings: what is grasped, by which programme, seen from where, and what it is not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from bags import programmes, settings
from bags.scanner import Scanner, View
from bags.session import Session
from bags.stage import Imperfections, Setting

SMALL_SCANS = Scanner(most_points=30000)
ELASTIC = 'The rubber is elastic: no relaxation, no felt.'
NO_SCAN_TIME = (
    'A real scan of ten views takes twenty minutes or more, in which the gauges drift; here it '
    'takes no time.'
)


@dataclass(frozen=True)
class Experiment:
    """One recording: a stage, a programme, and the words that describe it.

    `object_name`: an object of `shell_deform`, or `object.yaml`, whose text is then in
    `object_file`. `frame`: what the object's frame is.
    """

    name: str
    title: str
    object_name: str
    frame: str
    seed: int
    setting: Callable[[], Setting]
    programme: Callable[[Session], None]
    views: tuple[View, ...]
    story: str
    caveats: tuple[str, ...] = ()
    object_file: Callable[[], dict] | None = None
    scanner: Scanner = field(default_factory=Scanner)
    imperfections: Imperfections = field(default_factory=Imperfections)
    period_s: float = 0.01
    facts: dict = field(default_factory=dict)


def _views(*angles: tuple[float, float]) -> tuple[View, ...]:
    return tuple(View(azimuth, elevation) for azimuth, elevation in angles)


# Looks along the pins and from above; the laser stands to the left of the camera.
BALL_VIEWS = _views(
    (-62.0, 12.0), (28.0, 12.0), (78.0, 12.0), (118.0, 12.0), (208.0, 12.0), (258.0, 12.0),
    (-35.0, 50.0), (15.0, 50.0), (145.0, 50.0), (195.0, 50.0),
)  # fmt: skip
RING_VIEWS = _views(*((float(azimuth), 15.0) for azimuth in range(0, 360, 45)), (20.0, 55.0),
                    (140.0, 55.0), (260.0, 55.0))  # fmt: skip
CAN_VIEWS = _views(
    (20.0, 8.0), (45.0, 8.0), (70.0, 8.0), (110.0, 8.0), (135.0, 8.0), (160.0, 8.0),
    (60.0, 40.0), (120.0, 40.0), (75.0, -25.0), (105.0, -25.0),
)  # fmt: skip


TENNIS_BALL = Experiment(
    name='tennis_ball_two_finger',
    title='A tennis ball between two pins at the four published loads',
    object_name='tennis_ball',
    frame='origin at the centre; x along the pins from finger 1 to finger 2',
    seed=9,
    setting=settings.ball_between_two_pins,
    programme=programmes.published_loads('tennis_ball', first_s=3.5),
    views=BALL_VIEWS,
    story=(
        'Fingers 1 and 2 of a BarrettHand BH8-262 squeeze a ball of 65 mm between two pins of '
        '1 mm radius. The ball is scanned undeformed on its stand, then at 2.39, 3.71, 4.58 and '
        '4.83 lbf per finger. Each load is held for 3 s and scanned in its middle.'
    ),
    caveats=(
        NO_SCAN_TIME,
        'The two larger loads lie at the end of the gauge, whose documented range is +-1 N m.',
        ELASTIC,
    ),
)

# The other recordings of the ball between two pins differ in programme and words.
SMALL_BALL = replace(TENNIS_BALL, scanner=SMALL_SCANS)

HALF_CAN = Experiment(
    name='half_soda_can',
    title='Half a soda can under one pin at the published load',
    object_name='half_soda_can',
    frame='origin on the axis at half length; z along the can, crown at +y',
    seed=3,
    setting=settings.half_can_under_one_pin,
    programme=programmes.published_loads('half_soda_can', first_s=4.0),
    views=CAN_VIEWS,
    story=(
        'Finger 3 presses the crown of half a drinks can (outer diameter 66 mm, length 120 mm, '
        'wall 0.1 mm) with a pin of 1 mm radius and 0.17 lbf. Its straight edges are hinged, its '
        'ends free.'
    ),
    caveats=(
        NO_SCAN_TIME,
        '0.756 N are about four counts of the 8-bit gauge: one count is a quarter of the load.',
        'How the edges are held changes the stiffness by a factor of sixty and is an assumption '
        'here: no verdict between theories can be drawn from this recording.',
        'The can is lifted along with the pin, so that the pin does not slide.',
    ),
)

THREE_FINGERS = Experiment(
    name='tennis_ball_three_finger',
    title='A tennis ball between three pins',
    object_name='object.yaml',
    frame='origin at the centre; contacts at 0 (finger 3), 120 (1) and 240 degrees (2) about z',
    seed=11,
    setting=settings.ball_between_three_pins,
    programme=programmes.loads(6.0, 11.0, 16.0),
    views=RING_VIEWS,
    story=(
        'All three fingers, spread by 60 degrees, squeeze the ball on its equator, 120 degrees '
        'apart, with equal forces of 6, 11 and 16 N.'
    ),
    caveats=(
        NO_SCAN_TIME,
        ELASTIC,
        'The ball follows the mean height of the three pins; each pin slides by up to 1 mm '
        'against it, which the truth leaves out.',
    ),
    object_file=settings.three_finger_object,
    scanner=SMALL_SCANS,
)

FAST = replace(
    SMALL_BALL,
    name='fast_squeeze_release',
    title='A tennis ball squeezed and released faster and faster',
    seed=5,
    programme=programmes.fast_squeezes,
    story='Five squeezes to 16 N and back, in 1, 0.5, 0.25, 0.15 and 0.1 s each way.',
    caveats=('Quasi-static truth: no inertia, no damping.', ELASTIC),
)

REGRASP = replace(
    SMALL_BALL,
    name='regrasp_sliding',
    title='A tennis ball that slips under the pins and is grasped again',
    frame='origin at the centre; x along the pins at the first touch, then it slips',
    seed=6,
    programme=programmes.slide_and_regrasp,
    story=(
        'At 12 N the ball turns by 12 degrees about y under the pins, so that both contacts slide '
        'over it. It is let go, turned by 30 degrees about z and grasped again with 17 N.'
    ),
    caveats=(
        NO_SCAN_TIME,
        ELASTIC,
        'Sliding without friction: the dents stay under the pins and the force along them.',
        'The turn of the ball in `object_pose` is the true one, as a camera would give it.',
    ),
)

CUP = Experiment(
    name='cup_off_axis',
    title='A plastic cup between two pins that do not face each other',
    object_name='object.yaml',
    frame='origin at the centre of the foot; z along the axis, contacts at +-75 degrees from x',
    seed=12,
    setting=settings.cup_between_two_pins,
    programme=programmes.loads(2.0, 4.0, 6.5),
    views=RING_VIEWS,
    story=(
        'Fingers 1 and 2, spread by 75 degrees, press a thin cup of free-form profile with its '
        'foot clamped, 150 degrees apart and 24 mm below the rim, with 2, 4 and 6.5 N.'
    ),
    caveats=(
        NO_SCAN_TIME,
        'The cup is lifted along with the pins; beside that the solid lets what is under a pin '
        'slide without friction (`pins_slide`).',
        'Neo-Hooke material for a stiff plastic at small strain: no yield, no creep.',
    ),
    object_file=settings.cup_object,
    scanner=SMALL_SCANS,
    facts={'pins_slide': True},
)

DRIFT = replace(
    SMALL_BALL,
    name='gauge_drift',
    title='Half an hour of gauge drift in half a minute',
    seed=7,
    programme=programmes.drift,
    story=(
        'After the tare the gauges live sixty times as fast as the stamps: warm-up and random '
        'walk of half an hour in 30 s. Five squeezes to 10.63 N, the hand free between them.'
    ),
    caveats=('Time-lapse: the drift per second of stamp is sixty times the real one.', ELASTIC),
    facts={'gauge_time_lapse': programmes.TIME_LAPSE},
)

SATURATION = replace(
    SMALL_BALL,
    name='gauge_saturation',
    title='A squeeze past the end of the gauges',
    seed=4,
    programme=programmes.saturation,
    story=(
        'Up to 31 N per finger and back. The 8-bit gauges, whose zeros lie high, end at 255 '
        'counts: the force is then unknown, the encoders still tell the separation of the pins.'
    ),
    caveats=('Nothing protects this hand from overload.', ELASTIC),
)

LONG_HOLD = replace(
    SMALL_BALL,
    name='long_hold',
    title='Ten minutes of a held ball that relaxes, in 36 seconds',
    object_name='object.yaml',
    object_file=settings.relaxing_ball_object,
    seed=11,
    setting=settings.relaxing_ball_between_two_pins,
    programme=programmes.long_hold,
    story=(
        'A squeeze to 16 N; then the motors stand still. The force of the ball falls by 3 % for '
        'every tenfold time, the gauges, warm for three hours, walk by a tenth of a count in a '
        'root minute, and the tendons give back a little travel.'
    ),
    caveats=(
        'Time-lapse: rubber and gauges live seventeen times as fast as the stamps.',
        'One function of time relaxes the force of the whole ball, its air too: a closed form, '
        '1 - 0.03 log10(1 + t / 0.1 s), superposed over all steps of the elastic force.',
    ),
    facts={'time_lapse': settings.HOLD_LAPSE},
)

EXPERIMENTS = {
    experiment.name: experiment
    for experiment in (
        TENNIS_BALL,
        HALF_CAN,
        THREE_FINGERS,
        FAST,
        REGRASP,
        CUP,
        DRIFT,
        SATURATION,
        LONG_HOLD,
    )
}
