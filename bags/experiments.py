"""The recordings: what is grasped, how the fingers move, when it is scanned."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

from bags import settings, solid_ball
from bags.scanner import Scanner, View
from bags.session import Session
from bags.stage import Imperfections, Setting

SMALL_SCANS = Scanner(most_points=30000)
TIME_LAPSE = 60.0
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


def paper_loads(session: Session) -> None:
    """Tare, scan the undeformed ball, then the published loads, each held and scanned."""
    session.hold(1.4)
    session.scan('undeformed')
    session.hold(0.2)
    for number, row in enumerate(solid_ball.published_rows('tennis_ball')):
        session.move_to(row['force_n'], 3.5 if number == 0 else 2.0)
        with session.held(row['force_n'], published_row=row['row']):
            session.hold(1.5)
            session.scan('held')
            session.hold(1.5)
    session.move_to(0.0, 3.0)
    session.hold(0.5)


def paper_can(session: Session) -> None:
    """Tare, scan the undeformed half can, press it with the published force, scan, let go."""
    (row,) = solid_ball.published_rows('half_soda_can')
    session.hold(1.4)
    session.scan('undeformed')
    session.hold(0.2)
    session.move_to(row['force_n'], 4.0)
    with session.held(row['force_n'], published_row=row['row']):
        session.hold(1.5)
        session.scan('held')
        session.hold(1.5)
    session.move_to(0.0, 3.0)
    session.hold(0.5)


def loads(*forces: float) -> Callable[[Session], None]:
    """A programme: scan undeformed, then hold and scan every force."""

    def programme(session: Session) -> None:
        session.hold(1.4)
        session.scan('undeformed')
        session.hold(0.2)
        for force in forces:
            session.move_to(force, 3.0)
            with session.held(force):
                session.hold(1.0)
                session.scan('held')
                session.hold(1.0)
        session.move_to(0.0, 3.0)
        session.hold(0.5)

    return programme


def fast_squeezes(session: Session) -> None:
    """Squeezes and releases from one second down to a tenth, with short holds between."""
    session.hold(1.4)
    session.scan('undeformed')
    for seconds in (1.0, 0.5, 0.25, 0.15, 0.1):
        session.move_to(16.0, seconds)
        with session.held(16.0):
            session.hold(0.5)
        session.move_to(0.0, seconds)
        session.hold(0.7)
    session.scan('undeformed')
    session.hold(0.3)


def slide_and_regrasp(session: Session) -> None:
    """Squeeze, let the ball slip 12 degrees under the pins, let go, grasp it turned by 30."""
    session.hold(1.4)
    session.scan('undeformed')
    session.move_to(12.0, 3.0)
    with session.held(12.0):
        session.hold(0.8)
        session.scan('held')
        session.hold(0.7)
    session.slide((0.0, 1.0, 0.0), 12.0, 2.0)
    with session.held(12.0, after='a slip of 12 degrees about y'):
        session.hold(0.8)
        session.scan('held')
        session.hold(0.7)
    session.move_to(0.0, 2.0)
    session.hold(0.5)
    session.slide((0.0, 0.0, 1.0), 30.0, 1.0)
    session.hold(0.5)
    session.move_to(17.0, 3.0)
    with session.held(17.0, after='a turn of 30 degrees about z while free'):
        session.hold(0.8)
        session.scan('held')
        session.hold(0.7)
    session.move_to(0.0, 2.5)
    session.hold(0.3)


def drift(session: Session) -> None:
    """Five squeezes in what the gauges take for half an hour; free for a while between them."""
    session.hold(1.4)
    session.scan('undeformed')
    session.stage.time_lapse = TIME_LAPSE
    for number in range(5):
        session.move_to(10.631249660472593, 1.0)
        with session.held(10.631249660472593):
            session.hold(3.0)
            if number == 4:
                session.scan('held')
        session.move_to(0.0, 1.0)
        session.hold(1.0)


def saturation(session: Session) -> None:
    """Past the end of the gauges and back: 255 counts, then a force that can be trusted again."""
    session.hold(1.4)
    session.scan('undeformed')
    session.move_to(16.0, 3.0)
    with session.held(16.0):
        session.hold(1.5)
    session.move_to(31.0, 3.0)
    with session.held(31.0, gauge='at its end'):
        session.hold(1.0)
        session.scan('held')
        session.hold(1.0)
    session.move_to(16.0, 2.0)
    with session.held(16.0, after='saturation'):
        session.hold(1.5)
    session.move_to(0.0, 2.5)
    session.hold(0.5)


TENNIS_BALL = Experiment(
    name='tennis_ball_two_finger',
    title='A tennis ball between two pins at the four published loads',
    object_name='tennis_ball',
    frame='origin at the centre; x along the pins from finger 1 to finger 2',
    seed=9,
    setting=settings.ball_between_two_pins,
    programme=paper_loads,
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

HALF_CAN = Experiment(
    name='half_soda_can',
    title='Half a soda can under one pin at the published load',
    object_name='half_soda_can',
    frame='origin on the axis at half length; z along the can, crown at +y',
    seed=3,
    setting=settings.half_can_under_one_pin,
    programme=paper_can,
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
    programme=loads(6.0, 11.0, 16.0),
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

FAST = Experiment(
    name='fast_squeeze_release',
    title='A tennis ball squeezed and released faster and faster',
    object_name='tennis_ball',
    frame=TENNIS_BALL.frame,
    seed=5,
    setting=settings.ball_between_two_pins,
    programme=fast_squeezes,
    views=BALL_VIEWS,
    story='Five squeezes to 16 N and back, in 1, 0.5, 0.25, 0.15 and 0.1 s each way.',
    caveats=('Quasi-static truth: no inertia, no damping.', ELASTIC),
    scanner=SMALL_SCANS,
)

REGRASP = Experiment(
    name='regrasp_sliding',
    title='A tennis ball that slips under the pins and is grasped again',
    object_name='tennis_ball',
    frame='origin at the centre; x along the pins at the first touch, then it slips',
    seed=6,
    setting=settings.ball_between_two_pins,
    programme=slide_and_regrasp,
    views=BALL_VIEWS,
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
    scanner=SMALL_SCANS,
)

CUP = Experiment(
    name='cup_off_axis',
    title='A plastic cup between two pins that do not face each other',
    object_name='object.yaml',
    frame='origin at the centre of the foot; z along the axis, contacts at +-75 degrees from x',
    seed=12,
    setting=settings.cup_between_two_pins,
    programme=loads(2.0, 4.0, 6.5),
    views=RING_VIEWS,
    story=(
        'Fingers 1 and 2, spread by 75 degrees, press a thin cup of free-form profile with its '
        'foot clamped, 150 degrees apart and 24 mm below the rim, with 2, 4 and 6.5 N.'
    ),
    caveats=(
        NO_SCAN_TIME,
        'The cup is lifted along with the pins, so that they do not slide.',
        'Neo-Hooke material for a stiff plastic at small strain: no yield, no creep.',
    ),
    object_file=settings.cup_object,
    scanner=SMALL_SCANS,
)

DRIFT = Experiment(
    name='gauge_drift',
    title='Half an hour of gauge drift in half a minute',
    object_name='tennis_ball',
    frame=TENNIS_BALL.frame,
    seed=7,
    setting=settings.ball_between_two_pins,
    programme=drift,
    views=BALL_VIEWS,
    story=(
        'After the tare the gauges live sixty times as fast as the stamps: warm-up and random '
        'walk of half an hour in 30 s. Five squeezes to 10.63 N, the hand free between them.'
    ),
    caveats=('Time-lapse: the drift per second of stamp is sixty times the real one.', ELASTIC),
    scanner=SMALL_SCANS,
    facts={'gauge_time_lapse': TIME_LAPSE},
)

SATURATION = Experiment(
    name='gauge_saturation',
    title='A squeeze past the end of the gauges',
    object_name='tennis_ball',
    frame=TENNIS_BALL.frame,
    seed=4,
    setting=settings.ball_between_two_pins,
    programme=saturation,
    views=BALL_VIEWS,
    story=(
        'Up to 31 N per finger and back. The 8-bit gauges, whose zeros lie high, end at 255 '
        'counts: the force is then unknown, the encoders still tell the separation of the pins.'
    ),
    caveats=('Nothing protects this hand from overload.', ELASTIC),
    scanner=replace(SMALL_SCANS),
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
    )
}
