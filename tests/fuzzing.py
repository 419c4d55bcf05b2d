# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Damaged files for tests, and a way to watch time and memory while they are read."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Callable

import numpy as np

SECONDS_ALLOWED = 10.0
BYTES_ALLOWED = 1 << 30


def damaged(data: bytes, rng: np.random.Generator, other: bytes | None = None) -> bytes:
    """Return the bytes with a few bits flipped, a part missing, repeated, swapped or replaced."""
    result = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        size = len(result)
        if size < 16:
            break
        start = int(rng.integers(size))
        length = int(min(rng.geometric(0.02) * rng.choice([1, 4, 64]), size - start))
        match int(rng.integers(8)):
            case 0:
                result[start] ^= 1 << int(rng.integers(8))
            case 1:
                result[start : start + length] = rng.bytes(length)
            case 2:
                del result[start:]
            case 3:
                del result[start : start + length]
            case 4:
                target = int(rng.integers(size))
                part = result[start : start + length]
                del result[start : start + length]
                result[target:target] = part
            case 5:
                # A length or a time that is absurd.
                number = (0, 2**31, 2**32 - 1, 2**62, 2**63, 2**64 - 1)[int(rng.integers(6))]
                result[start : start + 8] = number.to_bytes(8, 'little')
            case 6:
                result[start:start] = result[start : start + length]
            case _ if other:
                begin = int(rng.integers(len(other)))
                result[start : start + length] = other[begin : begin + length]
            case _:
                result[start : start + length] = bytes(length)
    return bytes(result)


def damaged_text(text: str, rng: np.random.Generator) -> str:
    """Return YAML or JSON text with characters, lines or values changed."""
    lines = text.split('\n')
    for _ in range(int(rng.integers(1, 4))):
        place = int(rng.integers(len(lines)))
        line = lines[place]
        at = int(rng.integers(len(line) + 1))
        match int(rng.integers(7)):
            case 0:
                lines[place] = line[:at] + chr(int(rng.integers(1, 0x250))) + line[at + 1 :]
            case 1:
                lines.insert(int(rng.integers(len(lines))), lines[place])
            case 2 if len(lines) > 2:
                del lines[place]
            case 3:
                lines[place] = '  ' * int(rng.integers(3)) + line.lstrip()
            case 4:
                value = str(rng.choice(_VALUES))
                key = line.partition(':')[0]
                lines[place] = f'{key}: {value}'
            case 5:
                lines[place] = line[:at] + str(rng.choice(_PIECES)) + line[at:]
            case _:
                lines[place] = line[:at]
    return '\n'.join(lines)


_VALUES = (
    *('.nan', '.inf', '-1', '1e999', '1e-320', 'null', '~', '""', '[]', '{}', 'true', '0x10'),
    *('99999999999999999999', '[[[[]]]]', '{a: {b: c}}', '2026-01-01', '-0.0', '!!python/none'),
    *('1e300', '1e-300', '-1e300', '9' * 5000, 'x' * 300, '[' * 3000, '{"a": ' * 3000),
    *('"\\e[2J\\a"', '"a\\nerror: forged"', '"\\u202egnp"', '"\\u2028"', '"\\ud800"', '"\\x9b"'),
)
_PIECES = (
    *('&a ', '*a', '!!binary ', '!!set ', '<<: ', '? ', '- ', '|', '>', '%', '@', '`', '\t'),
    *('"', "'", '#', '{', '}', '[', ']', ',', ':', '\0', '\ud7ff', '\x85', '--- ', '...'),
)


class _TooLongError(Exception):
    pass


def peak_bytes() -> int:
    """Return the most memory that this process has had; getrusage counts that of its parent."""
    with open('/proc/self/status', encoding='ascii') as file:
        return next(int(line.split()[1]) for line in file if line.startswith('VmHWM')) * 1024


def watch(calls: Callable[[int], Callable[[], str]], first: int, count: int) -> None:
    """Run calls; print as JSON what went wrong, and how calls ended. To be run in a process.

    Args:
        calls: gives the call of a number; it returns one word for how it ended.
        first: the first number.
        count: how many.
    """
    limit = peak_bytes() + BYTES_ALLOWED
    resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))

    def stop(_number: int, _frame: object) -> None:
        raise _TooLongError

    signal.signal(signal.SIGPROF, stop)
    problems, endings, slowest = [], {}, 0.0
    for number in range(first, first + count):
        call = calls(number)
        begin = time.process_time()
        signal.setitimer(signal.ITIMER_PROF, SECONDS_ALLOWED)
        try:
            word = call()
        except BaseException:
            word = 'failed'
            problems.append(f'{number}: {traceback.format_exc()[-1500:]}')
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        slowest = max(slowest, time.process_time() - begin)
        endings[word] = endings.get(word, 0) + 1
    peak = peak_bytes()
    print(json.dumps({'problems': problems, 'endings': endings, 'slowest': slowest, 'peak': peak}))


def watched(module: str, first: int, count: int) -> dict:
    """Run ``module`` with those numbers in a process of its own; return what :func:`watch` says."""
    done = subprocess.run(
        [sys.executable, '-m', module, str(first), str(count)],
        capture_output=True,
        text=True,
        check=False,
        env={**os.environ, 'PYTHONPATH': os.pathsep.join(sys.path)},
    )
    assert done.returncode == 0, f'the process ended with {done.returncode}: {done.stderr[-3000:]}'
    return json.loads(done.stdout)
