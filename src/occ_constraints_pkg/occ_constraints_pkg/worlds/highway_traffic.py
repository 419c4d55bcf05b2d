# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Highway traffic for many scenes at once: the vehicles of highway-env as arrays.

Kinematic bicycles (Polack et al. 2017), IDM (Treiber et al. 2000) for speed, MOBIL (Kesting et al.
2007) for lane changes, with the constants and the order of decisions of highway-env 1.12. The same
scene gives the same positions; ``tests/worlds/test_highway_reference.py`` compares them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from occ_constraints_pkg.worlds.highway_scenarios import LANE_WIDTH, SPEED_LIMIT, Scenario

LENGTH, WIDTH = 5.0, 2.0
STEP_SECONDS = 0.2
MOST_LANES = 3
_MAX_SPEED = 40.0

# IDM: m/s^2, m, s.
_ACC_MAX, _ACC, _BRAKE, _JAM, _HEADWAY = 6.0, 3.0, 5.0, 10.0, 1.5
_CLOSING = 2.0 * np.sqrt(_ACC * _BRAKE)
# MOBIL: m/s^2, m/s^2, s, m/s.
_LEAST_GAIN, _MOST_IMPOSED, _DELAY, _SLOWEST_CHANGE = 0.2, 2.0, 1.0, 1.0
# Lane keeping: 1/s. A steering angle is at most 60 degrees, and the slip angle that goes with it
# has this sine.
_HEADING_GAIN, _LATERAL_GAIN = 1 / 0.2, 1 / 0.6
_MAX_SLIP_SINE = float(np.sin(np.arctan(0.5 * np.tan(np.pi / 3))))
# A vehicle counts in each lane whose middle is this close, in m; smallest divisor.
_LANE_REACH = LANE_WIDTH / 2 + 1.0
_NEAR_ZERO = 1e-2

X, Y, HEADING, SPEED, DESIRED, DELTA, TIMER = range(7)
LANE, TARGET, IDENTITY = range(3)


class Traffic:
    """N scenes of V vehicles each, vehicles in the order of the road.

    Row r of a scene is its r-th vehicle from behind; ``whole[IDENTITY]`` identifies it, 0 being the
    ego. Exact ties in x do not occur and have no defined order.

    Attributes:
        real: (7, V, N) x, y, heading, speed, desired speed, IDM exponent, timer of lane changes:
            m, rad, m/s, s; y grows to the right, heading likewise.
        whole: (3, V, N) int: lane, lane aimed at, identity.
        lanes: (N,) int, number of lanes.
        ahead: (V, 3, N) int, row of the next vehicle ahead in each lane; V where there is none.
        behind: (V, 3, N) int, row of the next vehicle behind in each lane; -1 where there is none.
        colliding: (N,) bool, the ego overlaps another vehicle, or was about to a step ago.
        about_to_collide: (N,) bool, it will within a step if nobody changes speed or heading.
        cos, sin: (V, N) of the headings.

    Args:
        scenes: number N of scenes.
        vehicles: number V of vehicles in each.
        controlled: the ego is driven by the caller; ``False``: it is traffic like the others.
    """

    def __init__(self, scenes: int, vehicles: int, *, controlled: bool = True) -> None:
        self.real = np.zeros((7, vehicles, scenes))
        self.whole = np.zeros((3, vehicles, scenes), dtype=np.int64)
        self.lanes = np.full(scenes, MOST_LANES)
        self.ahead = np.zeros((vehicles, MOST_LANES, scenes), dtype=np.int64)
        self.behind = np.zeros((vehicles, MOST_LANES, scenes), dtype=np.int64)
        self.colliding = np.zeros(scenes, dtype=bool)
        self.about_to_collide = np.zeros(scenes, dtype=bool)
        self._controlled = controlled
        self._columns = np.arange(scenes)
        self.cos = np.ones((vehicles, scenes))
        self.sin = np.zeros((vehicles, scenes))

    @property
    def ego(self) -> np.ndarray:
        """(N,) int, row of the ego in each scene."""
        return np.argmin(self.whole[IDENTITY], axis=0)

    def start(self, scenes: np.ndarray, scenarios: Sequence[Scenario]) -> None:
        """Put scenarios into some of the scenes.

        Args:
            scenes: (n,) int, which scenes.
            scenarios: n scenarios of V vehicles.
        """
        for scene, given in zip(scenes, scenarios, strict=True):
            order = np.argsort(given.x, kind='stable')
            desired = given.desired_speed.copy()
            if self._controlled:
                # As in highway-env, others see the ego as a vehicle with desired speed 0, so no
                # traffic cuts in ahead of it.
                desired[0] = 0.0
            self.real[X, :, scene] = given.x[order]
            self.real[Y, :, scene] = given.y[order]
            self.real[HEADING, :, scene] = 0.0
            self.real[SPEED, :, scene] = given.speed[order]
            self.real[DESIRED, :, scene] = desired[order]
            self.real[DELTA, :, scene] = given.delta[order]
            self.real[TIMER, :, scene] = ((given.x + given.y) * np.pi % _DELAY)[order]
            self.whole[LANE, :, scene] = self.whole[TARGET, :, scene] = given.lane[order]
            self.whole[IDENTITY, :, scene] = order
            self.lanes[scene] = given.lanes
        self.refresh(scenes)

    def refresh(self, scenes: np.ndarray) -> None:
        """Recompute what is derived from the state of some scenes, after it was set."""
        self.colliding[scenes] = self.about_to_collide[scenes] = False
        self.cos[:, scenes] = np.cos(self.real[HEADING][:, scenes])
        self.sin[:, scenes] = np.sin(self.real[HEADING][:, scenes])
        ahead, behind = _neighbours(self.real[Y][:, scenes])
        self.ahead[:, :, scenes], self.behind[:, :, scenes] = ahead, behind

    def step(
        self, acceleration: np.ndarray | None = None, steering: np.ndarray | None = None
    ) -> None:
        """Let all vehicles decide, then move for :data:`STEP_SECONDS`.

        Args:
            acceleration: (N,) of the ego in m/s^2; ``None`` where it is traffic like the others.
            steering: (N,) its steering angle in rad, positive to the right.
        """
        wanted, slip = self._decide()
        if acceleration is not None and steering is not None:
            place = self.ego, self._columns
            speed = self.real[SPEED][place]
            wanted[place] = np.where(speed < 0.0, np.maximum(acceleration, -speed), acceleration)
            slip[place] = np.sin(np.arctan(0.5 * np.tan(steering)))
        self._move(wanted, slip)
        self._sort()
        self.cos, self.sin = np.cos(self.real[HEADING]), np.sin(self.real[HEADING])
        self.ahead, self.behind = _neighbours(self.real[Y])
        self._collide()

    def _decide(self) -> tuple[np.ndarray, np.ndarray]:
        """Choose lanes; return accelerations and sines of slip angles, (V, N) each."""
        _, y, heading, speed, desired, delta, _ = self.real
        lane, target, identity = self.whole
        free = _ACC * (1.0 - (np.maximum(speed, 0.0) / _divisor(desired)) ** delta)
        here = np.take_along_axis(self.ahead, lane[:, None, :], axis=1)[:, 0, :]
        wanted = free - self._interaction_all(here)
        self._change_lanes(free, wanted)
        changing = lane != target
        if self._controlled:
            changing &= identity > 0
        rows, scenes = np.nonzero(changing)
        if len(rows):
            there = self.ahead[rows, target[rows, scenes], scenes]
            towards = free[rows, scenes] - self._interaction(rows, there, scenes)
            wanted[rows, scenes] = np.minimum(wanted[rows, scenes], towards)
        np.clip(wanted, -_ACC_MAX, _ACC_MAX, out=wanted)
        inverse = 1.0 / _not_zero(speed)
        aim = np.arcsin(np.clip(_LATERAL_GAIN * (LANE_WIDTH * target - y) * inverse, -1.0, 1.0))
        np.clip(aim, -np.pi / 4, np.pi / 4, out=aim)
        slip = LENGTH / 2 * inverse * (_HEADING_GAIN * _wrapped(aim - heading))
        return wanted, np.clip(slip, -_MAX_SLIP_SINE, _MAX_SLIP_SINE)

    def _change_lanes(self, free: np.ndarray, wanted: np.ndarray) -> None:
        """Begin and abandon lane changes."""
        lane, target, identity = self.whole
        timer = self.real[TIMER]
        changing = lane != target
        due = (timer > _DELAY) & ~changing
        if self._controlled:
            changing &= identity > 0
            due &= identity > 0
        timer[due] = 0.0
        rows, scenes = np.nonzero(due & (np.abs(self.real[SPEED]) >= _SLOWEST_CHANGE))
        before = lane[rows, scenes]
        after = before.copy()
        # The right lane is checked last and wins.
        for side in (-1, 1):
            aimed = before + side
            possible = np.flatnonzero((aimed >= 0) & (aimed < self.lanes[scenes]))
            r, s, to = rows[possible], scenes[possible], aimed[possible]
            good = self._is_better(r, s, to, free, wanted)
            after[possible[good]] = to[good]
        begun = after != before
        new = np.zeros_like(changing)
        new[rows[begun], scenes[begun]] = True
        target[rows, scenes] = after
        self._abandon(changing, new)

    def _is_better(
        self,
        rows: np.ndarray,
        scenes: np.ndarray,
        to: np.ndarray,
        free: np.ndarray,
        wanted: np.ndarray,
    ) -> np.ndarray:
        """MOBIL without politeness: tell for each vehicle whether it should change to a lane."""
        ahead, behind = self.ahead[rows, to, scenes], self.behind[rows, to, scenes]
        gained = free[rows, scenes] - self._interaction(rows, ahead, scenes) - wanted[rows, scenes]
        good = ~(gained < _LEAST_GAIN)
        followed = np.flatnonzero(good & (behind >= 0))
        r, s, follower = rows[followed], scenes[followed], behind[followed]
        speed, desired = self.real[SPEED][follower, s], self.real[DESIRED][follower, s]
        share = np.maximum(speed, 0.0) / _divisor(desired)
        imposed = _ACC * (1.0 - share ** self.real[DELTA][r, s])
        imposed -= self._interaction(follower, r, s)
        good[followed[imposed < -_MOST_IMPOSED]] = False
        return good

    def _abandon(self, changing: np.ndarray, new: np.ndarray) -> None:
        """Stop changing where someone just ahead changes to the same lane.

        Vehicles decide one after another: each sees the lane changes that earlier ones have just
        begun or abandoned, but not those of later ones.
        """
        scenes, rows = np.nonzero((changing | new).T)
        lane, target, identity = self.whole
        conflicts: list[tuple[int, int, int]] = []
        for offset in range(1, len(scenes)):
            same = np.flatnonzero(scenes[offset:] == scenes[:-offset])
            if not len(same):
                break
            # Rows follow the road: the second of a pair is ahead.
            scene, rear, front = scenes[same], rows[same], rows[same + offset]
            meets = changing[rear, scene] & (target[rear, scene] == target[front, scene])
            scene, rear, front = scene[meets], rear[meets], front[meets]
            distance = self.real[X][front, scene] - self.real[X][rear, scene]
            near = distance < self._wanted_gap(rear, front, scene)
            conflicts += zip(scene[near], rear[near], front[near], strict=True)
        conflicts.sort(key=lambda pair: identity[pair[1], pair[0]])
        for column, behind, before in conflicts:
            earlier = identity[before, column] < identity[behind, column]
            if new[before, column] and not earlier:
                continue
            if target[before, column] == target[behind, column]:
                target[behind, column] = lane[behind, column]

    def _wanted_gap(self, rows: np.ndarray, ahead: np.ndarray, scenes: np.ndarray) -> np.ndarray:
        """Return the IDM's wanted distance to a vehicle ahead, for some vehicles."""
        speed, cos, sin = self.real[SPEED], self.cos, self.sin
        own, ahead_speed = speed[rows, scenes], speed[ahead, scenes]
        c, s = cos[rows, scenes], sin[rows, scenes]
        closing = (own * c - ahead_speed * cos[ahead, scenes]) * c
        closing += (own * s - ahead_speed * sin[ahead, scenes]) * s
        return _JAM + own * _HEADWAY + own * closing / _CLOSING

    def _interaction(self, rows: np.ndarray, ahead: np.ndarray, scenes: np.ndarray) -> np.ndarray:
        """Return the deceleration of some vehicles due to the vehicle ahead; 0 if there is none.

        Args:
            rows: (n,) of the vehicles.
            ahead: (n,) rows of those ahead, V for none.
            scenes: (n,) their scenes.
        """
        none = ahead >= len(self.cos)
        ahead = np.where(none, rows, ahead)
        gap = _not_zero(self.real[X][ahead, scenes] - self.real[X][rows, scenes])
        ratio = self._wanted_gap(rows, ahead, scenes) / gap
        return np.where(none, 0.0, _ACC * (ratio * ratio))

    def _interaction_all(self, ahead: np.ndarray) -> np.ndarray:
        """The same for every vehicle: ``ahead`` is (V, N)."""
        vehicles, scenes = ahead.shape
        none = ahead >= vehicles
        place = np.minimum(ahead, vehicles - 1) * scenes + self._columns
        x, speed, cos, sin = self.real[X], self.real[SPEED], self.cos, self.sin
        ahead_speed = speed.take(place)
        closing = (speed * cos - ahead_speed * cos.take(place)) * cos
        closing += (speed * sin - ahead_speed * sin.take(place)) * sin
        wanted = _JAM + speed * _HEADWAY + speed * closing / _CLOSING
        ratio = wanted / _not_zero(x.take(place) - x)
        return np.where(none, 0.0, _ACC * (ratio * ratio))

    def _move(self, acceleration: np.ndarray, slip: np.ndarray) -> None:
        x, y, heading, speed, _, _, timer = self.real
        fast = speed > _MAX_SPEED
        if fast.any():
            acceleration[fast] = np.minimum(acceleration[fast], _MAX_SPEED - speed[fast])
        course = heading + np.arcsin(slip)
        x += speed * np.cos(course) * STEP_SECONDS
        y += speed * np.sin(course) * STEP_SECONDS
        heading += speed * slip / (LENGTH / 2) * STEP_SECONDS
        speed += acceleration * STEP_SECONDS
        timer += STEP_SECONDS
        # The nearest lane; the left one of two that are equally near.
        nearest = np.ceil(y / LANE_WIDTH - 0.5)
        self.whole[LANE] = np.clip(nearest, 0, self.lanes - 1)

    def _sort(self) -> None:
        """Restore the order of the road by swapping neighbours."""
        x = self.real[X]
        while True:
            wrong = x[1:] < x[:-1]
            if not wrong.any():
                return
            for first in (0, 1):
                rows, scenes = np.nonzero(x[first + 1 :: 2] < x[first:-1:2])
                rows = 2 * rows + first
                for state in (self.real, self.whole):
                    kept = state[:, rows, scenes]
                    state[:, rows, scenes] = state[:, rows + 1, scenes]
                    state[:, rows + 1, scenes] = kept

    def _collide(self) -> None:
        """Tell where the ego overlaps another vehicle, now or within a step."""
        self.colliding[:] = self.about_to_collide
        self.about_to_collide[:] = False
        ego = self.ego
        x, y = self.real[X], self.real[Y]
        own_x, own_y = x[ego, self._columns], y[ego, self._columns]
        speed = self.real[SPEED][ego, self._columns]
        reach = np.hypot(LENGTH, WIDTH) + speed * STEP_SECONDS
        offset_x, offset_y = x - own_x, y - own_y
        near = offset_x * offset_x + offset_y * offset_y <= reach * np.abs(reach)
        near[ego, self._columns] = False
        rows, scenes = np.nonzero(near)
        if not len(rows):
            return
        egos = ego[scenes]
        offset = np.stack([offset_x[rows, scenes], offset_y[rows, scenes]])
        axes = np.stack([self.cos, self.sin])
        own, other = axes[:, egos, scenes], axes[:, rows, scenes]
        relative = self.real[SPEED][egos, scenes] * own - self.real[SPEED][rows, scenes] * other
        now, soon = _overlap(offset, own, other, relative * STEP_SECONDS)
        self.colliding[scenes[now]] = True
        self.about_to_collide[scenes[soon]] = True


def _overlap(
    offset: np.ndarray, own: np.ndarray, other: np.ndarray, moved: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return whether two vehicles overlap, and whether they will after the next step.

    Two rectangles are disjoint exactly if they are along the direction of one of their sides.

    Args:
        offset: (2, n) from the centre of the first to that of the second, in m.
        own: (2, n) unit vector along the first.
        other: (2, n) unit vector along the second.
        moved: (2, n) way of the first relative to the second, in m.
    """
    now, soon = np.ones((2, offset.shape[1]), dtype=bool)
    for along in (own, other):
        for axis in (along, np.stack([-along[1], along[0]])):
            reach = 0.0
            for vehicle in (own, other):
                cos = np.abs((vehicle * axis).sum(axis=0))
                sin = np.abs(vehicle[0] * axis[1] - vehicle[1] * axis[0])
                reach = reach + LENGTH / 2 * cos + WIDTH / 2 * sin
            distance, way = (offset * axis).sum(axis=0), (moved * axis).sum(axis=0)
            now &= np.abs(distance) <= reach
            # The first covers the interval that it sweeps.
            swept = np.maximum(np.minimum(way, 0.0) - distance, distance - np.maximum(way, 0.0))
            soon &= swept <= reach
    return now, soon


def _neighbours(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the next vehicles ahead and behind in each lane, (V, 3, N) each.

    Args:
        y: (V, N) of vehicles in the order of the road, in m.
    """
    vehicles, scenes = y.shape
    middles = LANE_WIDTH * np.arange(MOST_LANES)
    inside = np.abs(y[:, None, :] - middles[:, None]) <= _LANE_REACH
    ahead = np.empty(inside.shape, dtype=np.int64)
    behind = np.empty(inside.shape, dtype=np.int64)
    ahead[-1], behind[0] = vehicles, -1
    for row in range(1, vehicles):
        behind[row] = np.where(inside[row - 1], row - 1, behind[row - 1])
        ahead[-1 - row] = np.where(inside[-row], vehicles - row, ahead[-row])
    return ahead, behind


def _not_zero(values: np.ndarray) -> np.ndarray:
    return np.where(
        np.abs(values) > _NEAR_ZERO, values, np.where(values >= 0, _NEAR_ZERO, -_NEAR_ZERO)
    )


def _divisor(desired: np.ndarray) -> np.ndarray:
    """Return desired speeds within the limit, and never zero."""
    return np.maximum(np.clip(desired, 0.0, SPEED_LIMIT), _NEAR_ZERO)


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi
