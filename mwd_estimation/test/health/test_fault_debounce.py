"""A fault needs evidence again and again, and goes only on evidence of the contrary."""

import pytest

from mwd_estimation.health import fault_debounce as ev


class Book:
    """Checks and what is noted of them."""

    def __init__(self):
        self.checks, self.notes, self.tally, self.events = ev.blank()
        self.now = 0

    def see(self, k, *observations, details=(0, 0, 0)):
        for seen in observations:
            self.now += 10
            ev.note(self.notes, k, seen, self.now - 10, *details)
            ev.weigh(self.checks, self.notes, self.tally, self.events, self.now)
        return self.checks[k, ev.STATE]


@pytest.mark.parametrize(
    ("check", "need", "clear"),
    [
        (ev.STUCK + 4, 2, 4), (ev.SATURATED + 8, 4, 12), (ev.INVALID, 2, 4), (ev.DEAD + 2, 1, 4), (ev.UNIT + 1, 2, 2),
        (ev.AXES, 2, 2), (ev.SIGN, 2, 2), (ev.FRAME, 2, 2), (ev.ABSENT, 1, 2), (ev.RATE, 5, 4), (ev.STAMPS, 1, 1),
        (ev.HELD + 1, 8, 8), (ev.MISMATCH, 3, 2), (ev.CROSS, 2, 2), (ev.LENGTH, 4, 2), (ev.NOISE, 4, 4),
    ],
)  # fmt: skip
def test_each_check_needs_its_number_of_observations_in_a_row_and_as_many_to_go(check, need, clear):
    book = Book()
    assert book.see(check, *[ev.FOR] * (need - 1)) != ev.FAULT
    assert book.see(check, ev.FOR) == ev.FAULT
    assert book.checks[check, ev.FROM] == 0
    assert book.see(check, *[ev.AGAINST] * (clear - 1)) == ev.FAULT
    assert book.see(check, ev.AGAINST) == ev.OK
    assert [event[2] for event in book.events[: book.tally[ev.EVENTS]]] == [ev.FAULT, ev.OK]


def test_an_observation_against_wipes_those_for_a_fault_but_not_of_a_range():
    book = Book()
    assert book.see(ev.UNIT, ev.FOR, ev.AGAINST, ev.FOR) == ev.OK
    assert book.see(ev.SATURATED, ev.FOR, ev.FOR, ev.AGAINST, ev.FOR, ev.FOR) == ev.FAULT


def test_what_is_seen_strongly_counts_twice_and_of_a_force_only_that_makes_doubtful():
    book = Book()
    assert book.see(ev.LENGTH, ev.STRONGLY) != ev.FAULT
    assert book.see(ev.LENGTH, ev.STRONGLY) == ev.FAULT
    assert book.tally[ev.UNUSABLE] == ev.ACCEL
    book = Book()
    ev.note(book.notes, ev.LENGTH, ev.FOR, 0, 0, 0, 0)
    assert ev.suspected(book.checks, book.notes) == 0
    ev.note(book.notes, ev.LENGTH, ev.STRONGLY, 0, 0, 0, 0)
    assert ev.suspected(book.checks, book.notes) == ev.ACCEL


def test_what_shows_nothing_changes_nothing():
    book = Book()
    assert book.see(ev.AXES, ev.FOR, ev.NOTHING, ev.NOTHING, ev.FOR) == ev.FAULT
    assert book.see(ev.SIGN, ev.NOTHING) == ev.UNKNOWN


def test_a_fault_that_is_narrowed_down_is_told_anew_and_says_what_cannot_be_used():
    book = Book()
    book.see(ev.AXES, ev.FOR, ev.FOR, details=(6, 2, 0))
    assert book.tally[ev.UNUSABLE] == ev.GYRO | ev.ACCEL
    book.see(ev.AXES, ev.FOR, details=(0, 2, 0))
    assert book.tally[ev.EVENTS] == 2
    assert book.tally[ev.UNUSABLE] == ev.ACCEL
    book.see(ev.AXES, ev.FOR, details=(0, 2, 0))
    assert book.tally[ev.EVENTS] == 2


def test_an_axis_often_at_the_end_of_its_range_is_used_and_one_always_there_is_not():
    book = Book()
    book.see(ev.SATURATED + 1, *[ev.FOR] * 4, details=(ev.OFTEN, 0, 0))
    assert book.tally[ev.UNUSABLE] == 0
    book.see(ev.SATURATED + 1, ev.FOR, details=(ev.ALWAYS, 0, 0))
    assert book.tally[ev.UNUSABLE] == ev.GYRO


def test_what_speaks_against_a_sensor_makes_it_doubtful_until_it_is_named_or_six_seconds_have_passed():
    book = Book()
    ev.note(book.notes, ev.AXES, ev.FOR, 0, 0, 2, 4)
    assert ev.suspected(book.checks, book.notes) == ev.ACCEL | ev.MAG
    book.see(ev.UNIT, ev.FOR, ev.FOR)
    ev.note(book.notes, ev.UNIT, ev.FOR, 0, 1, 0, 0)
    assert ev.suspected(book.checks, book.notes) == 0
    ev.doubt(book.checks, book.tally, ev.GYRO | ev.MAG)
    assert book.tally[ev.SUSPECT] == ev.MAG
    for _ in range(11):
        ev.doubt(book.checks, book.tally, 0)
    assert book.tally[ev.SUSPECT] == ev.MAG
    ev.doubt(book.checks, book.tally, 0)
    assert book.tally[ev.SUSPECT] == 0
