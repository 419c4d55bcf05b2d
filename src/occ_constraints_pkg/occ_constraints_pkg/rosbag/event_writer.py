# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Writes recordings of events in a thread of its own, while messages go on coming."""

from __future__ import annotations

import json
import shutil
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from occ_constraints_pkg.errors import OccError
from occ_constraints_pkg.rosbag.event_bags import CUSTOM_KEY, Draft, EventBags, RemovedBag
from occ_constraints_pkg.rosbag.ring import Batch, Message

# How often the quota and the room on the disk are looked at.
_LOOK_SECONDS = 0.5
# A robot whose disk is full has other trouble than a recording that ends early.
_LEAVE_FREE_BYTES = 64 << 20


@dataclass(frozen=True)
class Outcome:
    """What became of a recording.

    Attributes:
        path: where it is, or was to be.
        document: what it says of itself: see :meth:`EventBagWriter.end`; empty where it failed.
        problem: why there is none, or why it ends early; empty where all is well.
        is_kept: whether the recording is there.
        removed: older recordings that were removed for the quota.
        seconds: from the order to end it to its being on the disk.
    """

    path: Path
    document: Mapping[str, Any]
    problem: str = ''
    is_kept: bool = True
    removed: tuple[RemovedBag, ...] = ()
    seconds: float = 0.0


class EventBagWriter:
    """Takes batches of messages from any thread and writes them in its own.

    One recording is written after the other, in the order of the calls. Whatever keeps one from
    being written costs that one only, and is told in its :class:`Outcome`.

    Attributes:
        outcomes: of the recordings that are finished, for whoever takes them from here.

    Args:
        bags: where the recordings go.
    """

    def __init__(self, bags: EventBags) -> None:
        self.outcomes: deque[Outcome] = deque()
        self._bags = bags
        self._orders: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        # Each is changed by one thread only.
        self._taken = self._done = 0
        self._ends = self._ended = 0
        self._draft: Draft | None = None
        self._path = Path()
        self._problem = ''
        self._removed: list[RemovedBag] = []
        self._count = 0
        self._looked = 0.0
        self._thread = threading.Thread(target=self._run, name='event bags', daemon=True)
        self._thread.start()

    @property
    def _hurries(self) -> bool:
        """Whether somebody waits for a recording that has all its messages."""
        return self._ended < self._ends

    @property
    def backlog(self) -> int:
        """Bytes in memory that were handed over and are not written yet."""
        return self._taken - self._done

    def begin(self, path: Path, document: Mapping[str, Any], latched: Sequence[Message]) -> None:
        """Begin a recording.

        Args:
            path: from :meth:`EventBags.next_path`.
            document: as in :meth:`end`, for whoever finds it unfinished.
            latched: what is written first.
        """
        self._orders.put(lambda: self._begin(path, document, latched))

    def describe(self, document: Mapping[str, Any]) -> None:
        """Replace what the recording says of itself as long as it is unfinished.

        Args:
            document: as in :meth:`end`.
        """
        self._orders.put(lambda: self._describe(document))

    def put(self, batch: Batch) -> None:
        """Write a batch of messages."""
        self._taken += batch.size
        self._orders.put(lambda: self._put(batch))

    def end(self, document: Mapping[str, Any]) -> None:
        """Finish the recording.

        Args:
            document: plain values that it keeps, as JSON, under :data:`CUSTOM_KEY`; ``complete``
                and ``reason`` are replaced where it ended early, and ``messages`` is added.
        """
        ordered = time.monotonic()
        self._ends += 1

        def end() -> None:
            self._end(document, ordered)
            self._ended += 1

        self._orders.put(end)

    def close(self) -> None:
        """Write what is left and end the thread."""
        self._orders.put(None)
        self._thread.join()

    def _run(self) -> None:
        while (order := self._orders.get()) is not None:
            begin, began = time.thread_time(), time.monotonic()
            order()
            if not self._hurries:
                # What came before an event need not be written at once: half of the time is left
                # to whoever captures, and to the nodes that watch over the robot. On a busy
                # machine, or with a slow disk, others have had their half by now.
                rest = 2.0 * (time.thread_time() - begin) - (time.monotonic() - began)
                time.sleep(max(0.0, rest))
        if self._draft is not None:
            self._draft.discard()

    def _begin(self, path: Path, document: Mapping[str, Any], latched: Sequence[Message]) -> None:
        self._path, self._problem, self._removed, self._count = path, '', [], 0
        self._looked = -_LOOK_SECONDS
        try:
            self._draft = self._bags.begin(path, json.dumps(document))
            self._look()
            self._write(latched)
        except (OccError, OSError) as error:
            self._fail(error)

    def _describe(self, document: Mapping[str, Any]) -> None:
        if self._draft is not None:
            # It reaches the disk with the metadata, every few seconds.
            self._draft.writer.set_custom_data({CUSTOM_KEY: json.dumps(document)})

    def _put(self, batch: Batch) -> None:
        try:
            self._look()
            self._write(batch.messages)
        except (OccError, OSError) as error:
            self._fail(error)
        finally:
            self._done += batch.size

    def _write(self, messages: Sequence[Message]) -> None:
        if self._draft is None or self._problem:
            return
        write = self._draft.writer.write
        for topic, log_ns, publish_ns, data in messages:
            write(topic.name, topic.msgtype, data, log_ns, publish_ns, qos=topic.offered)
        self._count += len(messages)

    def _look(self) -> None:
        """End early when the quota or the disk has no more room."""
        now = time.monotonic()
        if self._draft is None or self._problem or now - self._looked < _LOOK_SECONDS:
            return
        self._looked = now
        removed, has_room = self._bags.make_room(self._draft.writer.size)
        self._removed += removed
        if not has_room:
            self._problem = 'the quota is used up by recordings that are pinned and by this one'
        elif shutil.disk_usage(self._bags.directory).free < _LEAVE_FREE_BYTES:
            self._problem = f'the disk has less than {_LEAVE_FREE_BYTES >> 20} MiB left'

    def _end(self, document: Mapping[str, Any], ordered: float) -> None:
        draft = self._draft
        if draft is None:
            return
        content = {**document, 'messages': self._count}
        if self._problem:
            content |= {'complete': False, 'reason': self._problem}
        if not self._count:
            self._draft = None
            draft.discard()
            problem = self._problem or 'there was no message'
            self._tell(Outcome(draft.path, {}, problem, False, tuple(self._removed)))
            return
        try:
            self._describe(content)
            bag = draft.finish()
        except (OccError, OSError) as error:
            self._fail(error)
            return
        self._draft = None
        self._bags.add(bag)
        removed, _ = self._bags.make_room(0)
        self._tell(
            Outcome(
                bag.path,
                content,
                self._problem,
                bag.path not in [one.path for one in removed],
                (*self._removed, *removed),
                time.monotonic() - ordered,
            )
        )

    def _fail(self, error: OccError | OSError) -> None:
        draft, self._draft = self._draft, None
        if draft is not None:
            # Half of it would be of less use than the room it takes.
            draft.discard()
        # What the recorder of ordinary bags says ends with what it keeps, which is nothing here.
        cause = error.__cause__ if isinstance(error.__cause__, OSError) else error
        problem = f'it cannot be written: {getattr(cause, "strerror", None) or cause}'
        self._tell(Outcome(self._path, {}, problem, False, tuple(self._removed)))

    def _tell(self, outcome: Outcome) -> None:
        self.outcomes.append(outcome)
