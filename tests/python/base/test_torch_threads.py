"""The number of torch's threads is found by timing the work itself."""

import torch

from sim2vr_harness.base.torch_threads import FastestThreads


class Work:
    """Takes so many seconds with so many threads, by a clock of its own."""

    def __init__(self, seconds: dict[int, float]) -> None:
        self.now, self.seconds = 0.0, seconds
        self.used: list[int] = []

    def do(self, threads: FastestThreads, times: int) -> None:
        for _ in range(times):
            with threads.turn() as count:
                assert torch.get_num_threads() == count
                self.used.append(count)
                self.now += self.seconds[count]


def test_candidates_take_turns_and_the_fastest_stays() -> None:
    work, before = Work({1: 2.0, 2: 2.5}), torch.get_num_threads()
    threads = FastestThreads([1, 2], clock=lambda: work.now)
    work.do(threads, 8)
    assert work.used == [1, 2, 1, 2, 1, 2, 1, 1]
    assert torch.get_num_threads() == before


def test_one_slow_turn_does_not_decide() -> None:
    work = Work({1: 2.0, 2: 1.0})
    threads = FastestThreads([1, 2], clock=lambda: work.now)
    work.do(threads, 3)
    work.seconds[2] = 100.0  # another program took the core once
    work.do(threads, 1)
    work.seconds[2] = 1.0
    work.do(threads, 2)
    assert threads.best == 2


def test_it_finds_out_anew_when_the_neighbours_have_changed() -> None:
    work = Work({1: 2.0, 2: 1.0})
    threads = FastestThreads([1, 2], clock=lambda: work.now)
    work.do(threads, 6)
    assert threads.best == 2
    work.seconds[2] = 9.0
    threads.measure()
    work.do(threads, 7)
    assert work.used[6:] == [1, 2, 1, 1, 1, 1, 1]
