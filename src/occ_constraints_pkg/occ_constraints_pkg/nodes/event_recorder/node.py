# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Node ``event_recorder``: keeps what happened as events, and says why the robot stopped."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from std_msgs.msg import String
from std_srvs.srv import Trigger

from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.events.derivation import Change, Settings
from occ_constraints_pkg.events.event import Event, new_id
from occ_constraints_pkg.events.journal import Journal
from occ_constraints_pkg.events.store import MAX_BYTES, EventStore, default_directory
from occ_constraints_pkg.nodes.event_recorder.incidents import IncidentRecorder
from occ_constraints_pkg.nodes.event_recorder.incidents import Settings as RecordingSettings
from occ_constraints_pkg.nodes.event_recorder.sources import GateSource, Moment, VerdictSource
from occ_constraints_pkg.ros.diagnostics import hardware_id_of, status
from occ_constraints_pkg.ros.node import OccNode
from occ_constraints_pkg.ros.process import run_node
from occ_constraints_pkg.ros.qos import STEPS, overridable
from occ_constraints_pkg.wording import count_of

_TICK_SECONDS = 0.1
_REPORT_SECONDS = 1.0
# After a start, subscribers need some time to find this node; whether any comes is not known.
_SETTLE_SECONDS, _MOST_WAITS = 2.0, 10
_LEVELS = {'violation': DiagnosticStatus.ERROR, 'stop': DiagnosticStatus.ERROR}


class EventRecorder(OccNode):
    """Turns verdicts and gate states into events, keeps them, and publishes them."""

    # A flood of verdicts must not keep the gate's states waiting.
    takes_turns = True

    def __init__(self) -> None:
        super().__init__('event_recorder')
        folder = self.parameter(
            'store', '', 'directory of the event store; none: ~/.ros/occ_events/NAMESPACE'
        )
        max_bytes = self.parameter(
            'store_bytes', MAX_BYTES, 'size above which the oldest events are removed', low=1 << 20
        )
        topics = self.parameter(
            'violation_topics', [], 'topics of verdicts, one for each monitor; none: violation'
        )
        gates = self.parameter('gates', ['gate'], 'names of the gates whose stops are kept')
        defaults = Settings()
        bridge = self.parameter(
            'bridge',
            defaults.bridge,
            'seconds; violations of a rule that are no further apart are one event',
            low=0.0,
        )
        timeout = self.parameter(
            'timeout',
            defaults.timeout,
            'seconds that a verdict is valid without new input, as of the monitor',
            low=0.01,
        )
        near_margin = self.parameter(
            'near_margin', 0.02, 'margin under which SAFE is a near miss; 0: never', low=0.0
        )
        recording = RecordingSettings.declare(self)
        self.declared()
        settings = Settings(bridge, timeout, near_margin)
        self._store = EventStore(
            os.path.expanduser(folder) or default_directory(self.get_namespace()),
            max_bytes=max_bytes,
        )
        self._events = self.create_publisher(
            String, 'events', STEPS, qos_overriding_options=overridable()
        )
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 10)
        self._journal = Journal(self._store, self._tell)
        self._listeners: list[Callable[[Event, str], None]] = []
        topics = topics or ['violation']
        if len({self.full_name(topic) for topic in topics}) < len(topics):
            raise ConfigurationError(
                f'violation_topics: got {", ".join(topics)}; allowed is each topic only once'
            )
        self._sources: list[VerdictSource | GateSource] = [
            VerdictSource(self, topic, settings, self._take) for topic in topics
        ]
        self._sources += [
            GateSource(self, gate, self._take, self._recent) for gate in dict.fromkeys(gates)
        ]
        self._incidents: IncidentRecorder | None = None
        if recording.is_on:
            self._incidents = IncidentRecorder(
                self,
                recording,
                self.store_directory / 'bags',
                self.name_bag,
                self.pinned_bags,
            )
            self.add_listener(self._incidents.on_event)
        self.create_service(Trigger, '~/trigger', self._on_trigger)
        self._logged_problem, self._waits = '', 0
        self.steady_timer(_TICK_SECONDS, self._tick)
        self.steady_timer(_REPORT_SECONDS, self._report)

    def begin(self) -> None:
        """Say what is kept where, and what an earlier run left open."""
        log = self.get_logger()
        if self._store.damaged is not None:
            log.warning(
                f'{self._store.path} could not be read; it is kept as {self._store.damaged.name}'
            )
        if self._store.interrupted:
            count = count_of(len(self._store.interrupted), 'event')
            log.warning(f'{count} went on when an earlier recorder ended; closed as interrupted')
            self._telling = self.steady_timer(_SETTLE_SECONDS, self._tell_interrupted)
        log.info(f'keeping events in {self._store.path}')
        if self._incidents is not None:
            self._incidents.begin()

    def _tell_interrupted(self) -> None:
        self._waits += 1
        if not self._events.get_subscription_count() and self._waits < _MOST_WAITS:
            return
        self._telling.cancel()
        self._take([(event, 'ended') for event in self._store.interrupted])

    @property
    def store_directory(self) -> Path:
        """Where the store is."""
        return self._store.path.parent

    def add_listener(self, listener: Callable[[Event, str], None]) -> None:
        """Call somebody with each event and phase that is published, after it was."""
        self._listeners.append(listener)

    def trigger(self, reason: str) -> Event:
        """Keep that somebody asked for a recording, as an event without duration."""
        now = Moment.now()
        event = Event(
            id=new_id(now.wall),
            kind='trigger',
            robot=self.get_namespace(),
            text=f'triggered: {reason}' if reason else 'triggered',
            began=now.wall,
            worst=now.wall,
            ended=now.wall,
            reason=reason,
        )
        self._take([(event, 'began'), (event, 'ended')])
        return event

    def name_bag(self, ids: Iterable[str], bag: str | None) -> None:
        """Keep and publish which recording has the seconds around some events; None: removed."""
        now = Moment.now()
        self._journal.name_bag(ids, bag, wall=now.wall, steady=now.steady)

    def pinned_bags(self) -> set[str]:
        """Return the recordings that must stay, for a pinned event names them."""
        return self._store.pinned_bags()

    def close(self) -> None:
        """Close what goes on, as the recorder hears nothing of it any more."""
        now = Moment.now()
        for source in self._sources:
            self._take(source.close(now, 'the recorder was ended'))
        if self._incidents is not None:
            self._incidents.close()
        self._journal.tick(wall=now.wall, steady=now.steady + 10**10)
        if self._journal.waiting:
            lost = count_of(self._journal.waiting, 'event')
            self.get_logger().error(f'{lost} could not be kept: {self._journal.problem}')
        self._store.close()
        self.flush(self._events)

    def _on_trigger(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        event = self.trigger('')
        bag = None if self._incidents is None else self._incidents.bag_of(event.id)
        response.success = bag is not None
        response.message = str(bag or 'the event is kept, but there are no bags of such events')
        return response

    def _recent(self) -> list[Event]:
        return list(self._journal.recent.values())

    def _take(self, changes: list[Change]) -> None:
        if changes:
            now = Moment.now()
            self._journal.add(changes, wall=now.wall, steady=now.steady)

    def _tell(self, event: Event, phase: str) -> None:
        self._events.publish(String(data=event.to_json(phase)))
        for listener in self._listeners:
            listener(event, phase)

    def _tick(self) -> None:
        now = Moment.now()
        for source in self._sources:
            self._take(source.tick(now))
        self._journal.tick(wall=now.wall, steady=now.steady)
        problem = self._journal.problem
        if problem != self._logged_problem:
            self._logged_problem = problem
            log = self.get_logger()
            if problem:
                log.error(f'{problem}; events wait in memory, and are published all the same')
            else:
                log.info('the event store is written again')

    def _report(self) -> None:
        journal, name = self._journal, self.get_fully_qualified_name().lstrip('/')
        going_on = [event for event in journal.recent.values() if event.ended is None]
        robot = hardware_id_of(self.get_namespace())
        level = max(
            (_LEVELS.get(event.kind, DiagnosticStatus.WARN) for event in going_on),
            default=DiagnosticStatus.OK,
        )
        newest = next(reversed(journal.recent.values()), None)
        last = {} if newest is None else {'newest': newest.text, 'newest_id': newest.id}
        events = status(
            f'{name}: events',
            level,
            '; '.join(event.text for event in going_on[:3]) or 'nothing goes on',
            {'going_on': len(going_on), **last},
            robot,
        )
        problem = journal.problem
        text = f'{count_of(journal.waiting, "event")} not kept yet: {problem}'
        store = status(
            f'{name}: store',
            DiagnosticStatus.ERROR if problem else DiagnosticStatus.OK,
            text if problem else 'all events are kept',
            {
                'path': self._store.path,
                'bytes': self._store.used_bytes,
                'waiting': journal.waiting,
                'lost': journal.lost,
            },
            robot,
        )
        message = DiagnosticArray(status=[events, store])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics.publish(message)


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run_node(EventRecorder, argv)
