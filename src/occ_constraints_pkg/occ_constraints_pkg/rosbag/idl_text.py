# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""IDL definitions in bags, reduced to what matters for decoding before a parser sees them.

The parser of ``rosbags`` computes constants of any size, and takes time exponential in nested
brackets. So constants are computed here, within 64 bits, put in where a length refers to them, and
left out, as are annotations and comments. What is left nests no deeper than types need.
"""

from __future__ import annotations

import math
import operator
import re
from collections.abc import Callable, Sequence

_TOKEN = re.compile(
    r"""
    \s+ | //[^\n]* | /\*.*?\*/ | ^[ \t]*\#[^\n]*        # blanks, comments, lines of a preprocessor
    | (?P<token>
        L?"(?:[^"\\]|\\.)*" | L?'(?:[^'\\]|\\.)+'
        | (?:::)?[A-Za-z_]\w*(?:::[A-Za-z_]\w*)*
        | \.?[0-9](?:[eE][+-]|[\w.])*
        | <<(?!<) | .
    )
    """,
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)
_MOST_TOKENS = 100_000
_MOST_IN_EXPRESSION = 100
_MOST_LEVELS = 8
_BITS = 64
_LONGEST_NUMBER = 40

Number = int | float

_OPERATORS: dict[str, tuple[int, Callable[[Number, Number], Number]]] = {
    '|': (1, operator.or_),
    '^': (2, operator.xor),
    '&': (3, operator.and_),
    '<<': (4, operator.lshift),
    '>>': (4, operator.rshift),
    '+': (5, operator.add),
    '-': (5, operator.sub),
    '*': (6, operator.mul),
    '/': (6, lambda a, b: a // b if isinstance(a, int) and isinstance(b, int) else a / b),
    '%': (6, operator.mod),
}
_SIGNS: dict[str, Callable[[Number], Number]] = {
    '+': operator.pos,
    '-': operator.neg,
    '~': operator.invert,
}
_WORDS = {'TRUE': 1, 'FALSE': 0}


class IdlError(ValueError):
    """The text is no IDL that can be used; the message says why, as part of a sentence."""


class _UnknownNameError(IdlError):
    pass


def reduced_idl(text: str) -> str:
    """Return the modules, structures, enumerations and type definitions of an IDL text.

    Raises:
        IdlError: a constant or length does not fit into 64 bits, or the text is too long or nests
            too deeply for the definition of a message.
    """
    tokens = [found['token'] for found in _TOKEN.finditer(text) if found['token']]
    if len(tokens) > _MOST_TOKENS:
        raise IdlError(f'it has {len(tokens)} words and marks; allowed are {_MOST_TOKENS}')
    return ' '.join(_Reducer(tokens).run())


class _Reducer:
    def __init__(self, tokens: Sequence[str]) -> None:
        self._tokens, self._place = tokens, 0
        self._kept: list[str] = []
        self._scope: list[str] = []
        self._constants: dict[str, Number] = {}

    def run(self) -> list[str]:
        opened = 0
        while self._place < len(self._tokens):
            token = self._next()
            if token == '@':
                self._pass_annotation()
            elif token == 'const':
                self._take_constant()
            elif token == '[':
                self._kept += ['[', str(self._length(self._until(']'))), ']']
            elif token == '}' and self._kept[-1:] == ['{'] and self._kept[-3:-2] == ['module']:
                # One of constants only: the parser knows no empty modules.
                del self._kept[-3:]
                self._close()
                if self._tokens[self._place : self._place + 1] == [';']:
                    self._place += 1
            else:
                self._keep(token)
                opened = max(0, opened + {'<': 1, '>': -1}.get(token, 0))
                if max(opened, len(self._scope)) > _MOST_LEVELS:
                    raise IdlError('it nests more deeply than a message does')
        return self._kept

    def _keep(self, token: str) -> None:
        if token == '{':
            self._scope.append(self._kept[-1] if self._kept else '')
        elif token == '}':
            self._close()
        elif self._is_bound():
            token = str(self._length([token]))
        elif not (token[0].isalnum() or token[0] in '_:;,<>='):
            raise IdlError(f'{token[:50]!r} is where no message has it')
        self._kept.append(token)

    def _is_bound(self) -> bool:
        """Tell whether the present token is the bound of a sequence or string."""
        closes = self._tokens[self._place : self._place + 1] == ['>']
        is_second = self._kept[-1:] == [',']
        of_string = self._kept[-2:] in (['string', '<'], ['wstring', '<'])
        return closes and (is_second or of_string)

    def _close(self) -> None:
        if self._scope:
            self._scope.pop()

    def _next(self) -> str:
        if self._place == len(self._tokens):
            raise IdlError('it ends in the middle')
        self._place += 1
        return self._tokens[self._place - 1]

    def _until(self, end: str) -> list[str]:
        """Return the tokens before ``end``, and pass over that."""
        found: list[str] = []
        while (token := self._next()) != end:
            found.append(token)
        return found

    def _pass_annotation(self) -> None:
        self._next()
        if self._tokens[self._place : self._place + 1] == ['(']:
            depth = 0
            while True:
                depth += {'(': 1, ')': -1}.get(self._next(), 0)
                if not depth:
                    return

    def _take_constant(self) -> None:
        *_, name = self._until('=') or ['']
        tokens = self._until(';')
        if all(token.lstrip('L')[:1] in ('"', "'") for token in tokens):
            return
        try:
            self._constants['::'.join([*self._scope, name])] = self._value(name, tokens)
        except _UnknownNameError:
            # It may be of an enumeration; only a length that refers to it needs its value.
            return

    def _length(self, tokens: list[str]) -> int:
        value = self._value('a length', tokens)
        if not isinstance(value, int) or value < 0:
            raise IdlError(f'a length is {value}; allowed are whole numbers from 0')
        return value

    def _value(self, what: str, tokens: list[str]) -> Number:
        if len(tokens) > _MOST_IN_EXPRESSION:
            raise IdlError(f'{what} is computed from {len(tokens)} words and marks')
        expression = _Expression(_joined(tokens), self._look_up)
        try:
            return expression.value()
        except (ArithmeticError, TypeError) as error:
            raise IdlError(f'{what} cannot be computed ({error})') from error

    def _look_up(self, name: str) -> Number:
        if name in _WORDS:
            return _WORDS[name]
        for size in range(len(self._scope), -1, -1):
            full = '::'.join([*self._scope[:size], name.removeprefix('::')])
            if full in self._constants:
                return self._constants[full]
        raise _UnknownNameError(f'the constant {name[:50]} is not defined')


class _Expression:
    """Computes with every step held to 64 bits."""

    def __init__(self, tokens: list[str], look_up: Callable[[str], Number]) -> None:
        self._tokens, self._look_up = tokens, look_up

    def value(self) -> Number:
        value = self._binary(1)
        if self._tokens:
            raise IdlError(f'{self._tokens[0][:50]!r} is no operator')
        return value

    def _binary(self, least: int) -> Number:
        left = self._unary()
        while self._tokens and _OPERATORS.get(self._tokens[0], (0,))[0] >= least:
            sign = self._tokens.pop(0)
            strength, compute = _OPERATORS[sign]
            right = self._binary(strength + 1)
            if sign in ('<<', '>>') and not 0 <= right < _BITS:
                raise IdlError(f'a shift by {right} bits; allowed are 0 to {_BITS - 1}')
            left = _bounded(compute(left, right))
        return left

    def _unary(self) -> Number:
        if not self._tokens:
            raise IdlError('an expression ends in the middle')
        token = self._tokens.pop(0)
        if token in _SIGNS:
            return _bounded(_SIGNS[token](self._unary()))
        if token == '(':
            value = self._binary(1)
            if self._tokens[:1] != [')']:
                raise IdlError('a bracket is not closed')
            self._tokens.pop(0)
            return value
        if token[0].isdigit() or token[0] == '.':
            return _bounded(_number(token))
        if token[0].isalpha() or token[0] in '_:':
            return self._look_up(token)
        raise IdlError(f'{token[:50]!r} is no number')


def _joined(tokens: list[str]) -> list[str]:
    """Return the tokens with two ``>`` as one operator; elsewhere they close two sequences."""
    joined: list[str] = []
    for token in tokens:
        if token == '>' and joined[-1:] == ['>']:
            joined[-1] = '>>'
        else:
            joined.append(token)
    return joined


def _number(token: str) -> Number:
    try:
        if len(token) > _LONGEST_NUMBER:
            raise ValueError
        if token[:2] in ('0x', '0X'):
            return int(token[2:], 16)
        if token.isdigit():
            return int(token, 8 if token[0] == '0' else 10)
        return float(token.rstrip('fFdDlL'))
    except ValueError:
        raise IdlError(f'{token[:50]!r} is no number of 64 bits') from None


def _bounded(value: Number) -> Number:
    if not (abs(value) < 2**_BITS if isinstance(value, int) else math.isfinite(value)):
        raise IdlError('a constant does not fit into 64 bits')
    return value
