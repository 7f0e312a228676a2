# SPDX-License-Identifier: Apache-2.0
"""The serial driver on an emulated hand, on simulated time: set-up, cycles, trouble."""

import pytest

from barrett_hand_bridge.emulator.direct_port import DirectPort
from barrett_hand_bridge.emulator.mechanics import HandBody, HandMechanics
from barrett_hand_bridge.emulator.serial_hand import SerialHand as EmulatedHand
from barrett_hand_bridge.gcl import driver, line
from barrett_hand_bridge.gcl.driver import SerialHand
from barrett_hand_bridge.gcl.port import open_port
from barrett_hand_bridge.hand import HandDisturbedError, HandError, HandNotInitialisedError


class NoisyPort(DirectPort):
    """A port whose next bytes can be lost, changed or added."""

    drop = 0
    garble = 0
    extra = b''

    def read(self, size=1):
        data = bytearray(super().read(size))
        while data and self.drop:
            self.drop -= 1
            data = data[1:] + super().read(1)
        for index in range(min(self.garble, len(data))):
            data[index] ^= 0xFF
            self.garble -= 1
        return bytes(data)

    @property
    def in_waiting(self):
        if self.extra:
            self._received += self.extra
            self.extra = b''
        return super().in_waiting


@pytest.fixture
def emulated():
    return EmulatedHand(HandMechanics(HandBody(), seed=2), serial_number=4711)


def connect(emulated, **options):
    ports = []

    def open_line():
        ports.append(NoisyPort(emulated))
        return ports[-1]

    options.setdefault('baud', 9600)
    hand = SerialHand(open_line, prefetch=False, **options)
    facts = hand.connect()
    return hand, facts, ports


def test_the_hand_says_what_it_is(emulated):
    _, facts, _ = connect(emulated)
    assert (facts.model, facts.firmware, facts.serial_number) == ('BH8-262', '4.4', '4711')
    assert facts.ceiling_hz == pytest.approx(74, abs=0.2)


def test_the_line_is_brought_to_the_wanted_speed(emulated):
    _, facts, ports = connect(emulated, baud=38400)
    assert emulated.baud == ports[-1].baudrate == 38400
    assert facts.ceiling_hz == pytest.approx(295, abs=0.5)


def test_a_hand_left_at_another_speed_is_found(emulated):
    emulated.parameters.hand['BAUD'] = 192
    _, _, ports = connect(emulated, baud=9600)
    assert ports[-1].baudrate == 9600


def test_a_hand_left_in_realtime_mode_is_found(emulated):
    emulated.feed(b'HI\r')
    emulated.advance(5.0)
    emulated.feed(b'1234LOOP\r')
    assert emulated.loop is not None
    hand, _, _ = connect(emulated)
    assert hand.sample(None).finger_counts == (0, 0, 0)


def test_cycles_need_an_initialised_hand(emulated):
    hand, _, _ = connect(emulated)
    with pytest.raises(HandNotInitialisedError, match='hand/initialize'):
        hand.sample(None)
    hand.initialize()
    assert hand.sample(None).gauge_counts == tuple(
        emulated.mechanics.gauges[finger].counts for finger in (1, 2, 3)
    )


def test_velocities_move_the_fingers_and_zero_stops_them(emulated):
    hand, _, _ = connect(emulated)
    hand.initialize()
    for _ in range(5):
        hand.sample({1: 0.3, 4: 0.5})
        emulated.advance(0.05)
    sample = hand.sample({})
    assert sample.finger_counts[0] * 140 / 17500 > 2.0
    assert sample.spread_counts > 0
    assert not emulated.mechanics.motors[1].moving


def test_a_lost_byte_is_noticed_and_the_hand_found_again(emulated, monkeypatch):
    monkeypatch.setattr(driver, 'PATIENCE_S', 0.02)
    hand, _, ports = connect(emulated)
    hand.initialize()
    hand.sample(None)
    ports[-1].drop = 1
    with pytest.raises(HandError, match='neither feedback nor an error'):
        hand.sample(None)
    assert hand.sample(None).finger_counts == (0, 0, 0)


def test_a_block_that_stays_short_is_called_late_and_then_lost(emulated, monkeypatch):
    monkeypatch.setattr(driver, 'PATIENCE_S', 0.02)
    hand, _, ports = connect(emulated)
    hand.initialize()
    hand.sample(None)
    late = []
    hand.late = lambda: late.append(1)
    original = ports[-1].read
    ports[-1].read = lambda size=1: original(size)[: 5 if size == 11 else size]
    with pytest.raises(HandError, match='bytes of a feedback block'):
        hand.sample(None)
    assert late


def test_garbled_positions_are_refused(emulated):
    hand, _, ports = connect(emulated)
    hand.initialize()
    hand.sample(None)
    emulated.mechanics.place({1: 200.0})

    class Garbling(NoisyPort):
        pass

    ports[-1].garble = 0
    original = ports[-1].read

    def read(size=1):
        data = original(size)
        return b'\x78\xff\xff' + data[3:] if size == 11 else data

    ports[-1].read = read
    with pytest.raises(HandError, match='beyond 17800'):
        hand.sample(None)
    del ports[-1].read
    assert hand.sample(None).finger_counts[0] == 200


def test_bytes_nobody_asked_for_are_noticed(emulated):
    hand, _, ports = connect(emulated)
    hand.initialize()
    hand.sample(None)
    ports[-1].extra = b'BarrettHand'
    with pytest.raises(HandError, match='nobody asked'):
        hand.sample(None)
    hand.sample(None)


def test_an_error_inside_the_loop_names_its_status(emulated):
    hand, _, _ = connect(emulated)
    hand.initialize()
    hand.sample(None)
    emulated.loop_error = 8192
    with pytest.raises(HandError, match='over-temperature'):
        hand.sample(None)
    hand.sample(None)


def test_a_brown_out_in_the_loop_means_connecting_and_initialising_again(emulated):
    hand, _, _ = connect(emulated)
    hand.initialize()
    hand.sample(None)
    emulated.power_cycle()
    with pytest.raises(HandError):
        hand.sample(None)
    hand.connect()
    with pytest.raises(HandNotInitialisedError):
        hand.sample(None)


def test_no_gauge_is_told_from_saturation(emulated):
    hand, _, _ = connect(emulated)
    emulated.mechanics.gauges[3].fitted = False
    hand.initialize()
    assert hand.sample(None).gauge_counts[2] is None
    emulated.mechanics.gauges[1].step(5.0, 0.01)
    assert hand.sample(None).gauge_counts[0] == 255


def test_flipped_gauges_are_turned_round(emulated):
    emulated.feed(b'2FSET SGFLIP 1\r')
    hand, _, _ = connect(emulated)
    hand.initialize()
    assert hand.sample(None).gauge_counts[1] == emulated.mechanics.gauges[2].counts


def test_a_clutch_that_let_go_is_seen_when_the_loop_is_entered(emulated):
    hand, _, _ = connect(emulated)
    hand.initialize()
    assert hand.sample(None).breakaway_counts == (None, None, None)
    emulated.mechanics.place({1: 3000.0})
    emulated.mechanics.breakaway_counts[1] = 2000.0
    hand.stop()
    assert hand.sample(None).breakaway_counts == (2000, None, None)


def test_breakaway_positions_are_read_when_asked_for(emulated):
    hand, _, _ = connect(emulated, feedback=('strain', 'position', 'breakaway'))
    hand.initialize()
    emulated.mechanics.place({1: 3000.0})
    emulated.mechanics.breakaway_counts[1] = 2000.0
    assert hand.sample(None).breakaway_counts == (2000, None, None)


def test_a_firmware_without_sgflip_is_taken_as_not_flipped(emulated, monkeypatch):
    known = emulated.motor_limits
    monkeypatch.setattr(emulated, 'motor_limits', lambda n: None if n == 'SGFLIP' else known(n))
    hand, _, _ = connect(emulated)
    hand.initialize()
    assert hand.sample(None).gauge_counts[1] == emulated.mechanics.gauges[2].counts


def test_breakaway_of_old_firmware_is_refused_with_its_number():
    emulated = EmulatedHand(HandMechanics(HandBody(), seed=2), firmware=(4, 3, 1))
    with pytest.raises(HandError, match='need firmware 4.4, this hand has 4.3'):
        connect(emulated, feedback=('position', 'breakaway'))


def test_changes_of_position_add_up_to_the_position(emulated):
    hand, facts, _ = connect(emulated, feedback=('strain', 'delta'))
    assert facts.ceiling_hz == pytest.approx(107, abs=0.5)
    hand.initialize()
    emulated.mechanics.place({2: 9000.0})
    assert hand.sample(None).finger_counts == (0, 9000, 0)
    emulated.mechanics.place({2: 8700.0, 4: 100.0})
    samples = [hand.sample(None) for _ in range(3)]
    # A change beyond one byte is handed over in parts.
    assert [sample.finger_counts[1] for sample in samples] == [8872, 8744, 8700]
    assert samples[-1].spread_counts == 100


def test_a_changed_delta_is_found_out_at_the_stop_and_read_anew(emulated):
    hand, _, ports = connect(emulated, feedback=('strain', 'delta'))
    hand.initialize()
    hand.sample(None)
    original = ports[-1].read
    ports[-1].read = lambda size=1: b'\x78\x80' + original(7)[2:] if size == 7 else original(size)
    with pytest.raises(HandDisturbedError, match='position -128'):
        hand.sample(None)
    del ports[-1].read
    assert hand.sample(None).finger_counts == (0, 0, 0)


@pytest.mark.parametrize('feedback', [('strain',), ('position', 'delta'), ('position', 'smell')])
def test_an_impossible_feedback_is_refused(feedback):
    with pytest.raises(HandError, match='feedback'):
        SerialHand(lambda: None, feedback=feedback)


@pytest.mark.parametrize(('firmware', 'size'), [((4, 3, 1), 2), ((4, 4, 0), 1)])
def test_temperature_is_read_in_the_size_of_the_firmware(firmware, size):
    emulated = EmulatedHand(HandMechanics(HandBody(), seed=2), firmware=firmware)
    hand, _, _ = connect(emulated, feedback=('strain', 'position', 'temperature'))
    hand.initialize()
    sample = hand.sample(None)
    assert hand.layout.temperature_bytes == size
    assert sample.temperature_c == pytest.approx(31.5, abs=0.6)


def test_strain_limits_are_set_in_the_hand_itself(emulated):
    hand, _, _ = connect(emulated)
    hand.limit_force({1: 200, 2: None, 3: 240})
    limits = [emulated.parameters.motor[finger]['HSG'] for finger in (1, 2, 3)]
    assert limits == [200, 256, 240]


def test_the_strain_limit_of_a_flipped_gauge_is_its_low_one(emulated):
    emulated.feed(b'2FSET SGFLIP 1\r')
    hand, _, _ = connect(emulated)
    hand.initialize()
    zero = emulated.mechanics.gauges[2].counts
    hand.limit_force({2: zero - 5})
    assert emulated.parameters.motor[2]['LSG'] == 255 - (zero - 5)
    hand.sample({2: 0.5})
    emulated.advance(0.1)
    assert not emulated.mechanics.motors[2].moving
    assert hand.sample(None).strain_limits == (None, zero - 5, None)


def test_closing_stops_the_motors(emulated):
    hand, _, _ = connect(emulated)
    hand.initialize()
    hand.sample({1: 0.5})
    hand.close()
    assert not emulated.mechanics.motors[1].moving
    assert emulated.loop is None


def test_a_silent_line_is_one_clear_sentence(monkeypatch):
    monkeypatch.setattr(line, 'SHORT_PATIENCE_S', 0.01)
    monkeypatch.setattr(line, 'LONG_PATIENCE_S', 0.02)

    class Silence:
        baudrate, timeout, in_waiting = 9600, 0.0, 0

        def read(self, size=1):
            return b''

        def write(self, data):
            return len(data)

        def close(self):
            self.closed = True

    with pytest.raises(
        HandError, match='no prompt from the hand at 9600, 38400, 19200 baud'
    ) as one:
        SerialHand(Silence, baud=9600).connect()
    assert 'memory' not in str(one.value)


class ForgetfulHand(EmulatedHand):
    """A hand that has lost its memory: what it was told to do it answers with `instead`."""

    instead = ''

    def _execute(self, line):
        if line.startswith(self.forgets):
            self._output += f'\n\r{self.instead}'.encode()
        else:
            super()._execute(line)


@pytest.mark.parametrize(
    ('forgets', 'instead'),
    [('', 'Load firmware?'), ('VERS', '\x7f\x01\n\r=> '), ('PGET', 'ERR 32\n\r=> ')],
)
def test_a_hand_that_stood_without_power_is_named_as_one(monkeypatch, forgets, instead):
    monkeypatch.setattr(line, 'SHORT_PATIENCE_S', 0.02)
    monkeypatch.setattr(line, 'LONG_PATIENCE_S', 0.02)
    hand = ForgetfulHand(HandMechanics(HandBody(), seed=2))
    hand.forgets, hand.instead = forgets, instead
    with pytest.raises(HandError, match='stood without power for a day.*loaded again$'):
        connect(hand)


def test_a_missing_port_is_named():
    with pytest.raises(HandError, match="'/dev/ttyNOT'"):
        open_port('/dev/ttyNOT')


def test_an_impossible_speed_is_refused():
    with pytest.raises(HandError, match='9600, 19200 and 38400'):
        SerialHand(lambda: None, baud=115200)


class CountingPort(DirectPort):
    """A port that counts what is written to it."""

    writes = 0

    def write(self, data):
        self.writes += 1
        return super().write(data)


@pytest.mark.parametrize('prefetch', [False, True])
def test_every_block_is_asked_for_once(emulated, prefetch):
    ports = []

    def open_line():
        ports.append(CountingPort(emulated))
        return ports[-1]

    hand = SerialHand(open_line, baud=38400, prefetch=prefetch)
    hand.connect()
    hand.initialize()
    hand.sample(None)
    before = ports[-1].writes
    for _ in range(10):
        hand.sample(None)
    assert ports[-1].writes - before == 10
