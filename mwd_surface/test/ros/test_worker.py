# SPDX-License-Identifier: Apache-2.0
"""Between the node's thread and others: work done beside it, and requests answered in it, at once or later."""

import concurrent.futures
import threading
import time

from mwd_surface.ros.context import BackgroundWorker, RequestQueue


def asked(requests, name, **arguments):
    """Ask in another thread, as a page does; the node answers here."""
    with concurrent.futures.ThreadPoolExecutor(1) as outside:
        promise = outside.submit(requests.call, name, arguments)
        while not promise.done():
            requests.run_requests()
        return promise.result()


def test_a_request_is_carried_out_in_the_nodes_own_thread():
    where = []

    def carry_out(name, arguments):
        where.append(threading.get_ident())
        return True, f"{name} {arguments['k']}"

    assert asked(RequestQueue(carry_out), "split", k=3) == (True, "split 3")
    assert where == [threading.get_ident()]


def test_an_answer_that_takes_its_time_is_waited_for_without_holding_the_node_up():
    later = concurrent.futures.Future()
    requests = RequestQueue(lambda _name, _arguments: later)
    with concurrent.futures.ThreadPoolExecutor(1) as outside:
        promise = outside.submit(requests.call, "export", {})
        while requests._queue.empty() and not promise.done():
            continue
        requests.run_requests()
        later.set_result((True, "written"))
        assert promise.result(5.0) == (True, "written")


def test_a_request_that_fails_inside_is_answered_in_words():
    def broken(_name, _arguments):
        raise KeyError("no such thing")

    ok, message = asked(RequestQueue(broken), "export")
    assert not ok
    assert "export failed inside the node" in message


def test_work_that_ends_while_the_node_asks_is_reported_once():
    class EndsWhileAsked(concurrent.futures.Future):
        def done(self):
            was = super().done()
            if not was:
                self.set_result("written")
            return was

    class Worker:
        def submit(self, _job):
            return EndsWhileAsked()

    worker, given = BackgroundWorker(), []
    worker.close()
    worker._executor = Worker()
    worker.submit(str, lambda job: given.append(job.result()))
    for _ in range(3):
        worker.run_callbacks()
    assert given == ["written"]


def test_slow_work_tells_of_itself_only_when_the_node_asks():
    worker, given, go = BackgroundWorker(), [], threading.Event()
    worker.submit(lambda: go.wait(5.0), lambda job: given.append(job.result()))
    worker.run_callbacks()
    assert given == []
    go.set()
    while not given:
        worker.run_callbacks()
    assert given == [True]
    worker.close()


def test_a_callback_that_fails_leaves_no_other_job_waiting_for_ever():
    worker, ended = BackgroundWorker(), []

    def fails(job):
        ended.append(1)
        job.result()

    worker.submit(lambda: 1 / 0, fails)
    for k in (2, 3):
        worker.submit(lambda k=k: k, lambda job: ended.append(job.result()))
    failures = 0
    end = time.monotonic() + 30.0
    while len(ended) < 3 and time.monotonic() < end:
        try:
            worker.run_callbacks()
        except ZeroDivisionError:
            failures += 1
    worker.close()
    assert (failures, sorted(ended)) == (1, [1, 2, 3])


def test_a_request_whose_answer_fails_later_is_answered():
    later = concurrent.futures.Future()
    later.set_exception(KeyError("depth"))
    ok, message = asked(RequestQueue(lambda _name, _arguments: later), "export")
    assert not ok
    assert "KeyError" in message


def test_a_file_under_way_is_written_before_the_worker_closes(tmp_path):
    worker, begun, go = BackgroundWorker(), threading.Event(), threading.Event()

    def write():
        begun.set()
        go.wait(5.0)
        (tmp_path / "well.las").write_text("whole")

    worker.submit(write, lambda _: None, writes=True)
    assert begun.wait(5.0)
    threading.Timer(0.2, go.set).start()
    worker.close()
    assert (tmp_path / "well.las").read_text() == "whole"
