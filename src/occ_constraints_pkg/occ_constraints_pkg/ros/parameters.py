# Copyright 2026 The occ_constraints developers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of a node: declared, checked and explained in one call, and none ignored."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, NamedTuple, TypeVar

import yaml
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from occ_constraints_pkg.documents import did_you_mean, read_text
from occ_constraints_pkg.errors import ConfigurationError
from occ_constraints_pkg.ros.parameter_files import names_of_sections
from occ_constraints_pkg.ros.rclpy_internals import parameter_overrides

# Parameters, true or false, that every node has from rclpy.
_ROS_SWITCHES = ('use_sim_time', 'start_type_description_service')
# How the parameters begin that override the quality of service of a topic.
_QOS_PREFIX = 'qos_overrides.'
_POLICIES = {
    'history': ('keep_last', 'keep_all', 'system_default'),
    'reliability': ('reliable', 'best_effort', 'system_default', 'best_available'),
    'depth': (),
    'durability': ('volatile', 'transient_local', 'system_default', 'best_available'),
    'liveliness': ('automatic', 'manual_by_topic', 'system_default', 'best_available'),
    'deadline': (),
    'liveliness_lease_duration': (),
}
# Of each policy that is a number, its least and largest value, and its unit; 0 ns means none.
_NUMBERS = {
    'depth': (1, 2**31 - 1, ''),
    'deadline': (0, 2**63 - 1, ' of ns'),
    'liveliness_lease_duration': (0, 2**63 - 1, ' of ns'),
}
# The overrides that a subscription of a node may ask for.
_OF_SUBSCRIPTION = re.compile(
    rf'{re.escape(_QOS_PREFIX)}.+\.subscription\.(history|depth|reliability)'
)
_QOS = re.compile(r'qos_overrides\.(?P<topic>.+)\.(?P<end>[^.]+)\.(?P<policy>[^.]+)')
# Those that ROS has besides: no misspellings.
_OTHER_POLICIES = ('avoid_ros_namespace_conventions', 'lifespan')

# So large a number of seconds is still finite in ns.
_LARGEST = 1e290

# The command line that this process was started with; rclpy keeps it where it cannot be read.
_command_line: list[str] = []
# What a node that is only described has declared so far; None for one that is to run.
_described: list[DescribedParameter] | None = None

_Value = TypeVar('_Value', bool, int, float, str, list)


class DescribedParameter(NamedTuple):
    """What ``--help`` prints of a parameter, each as text."""

    name: str
    default: str
    description: str
    bounds: str


class _DescribedError(Exception):
    """All parameters of a node that is only described are declared."""


class ParameterNode(Node):
    """A node that refuses parameters with wrong values or unknown names.

    Attributes:
        subscribes_later: whether it subscribes to topics that it learns of while it runs.

    Raises:
        OccError: a parameter of ROS's own, such as ``use_sim_time``, has a wrong value.
    """

    subscribes_later = False

    def __init__(self, name: str, **kwargs: Any) -> None:
        try:
            super().__init__(name, **kwargs)
        except InvalidParameterTypeException as error:
            wrong = next(
                item
                for item in parameter_overrides(self).values()
                if item.name in _ROS_SWITCHES and item.type_ != Parameter.Type.BOOL
            )
            raise ConfigurationError(
                f'parameter {wrong.name!r} of node {name!r}: got {wrong.value!r}; allowed is true '
                'or false'
            ) from error
        self._overrides = parameter_overrides(self)
        _check_qos_overrides(self._overrides.values())

    def parameter(
        self,
        name: str,
        default: _Value,
        description: str,
        *,
        low: float | None = None,
        high: float | None = None,
        read_only: bool = True,
    ) -> _Value:
        """Declare a parameter and return its value.

        An integer is accepted for a number with a decimal point, and one text for a list of texts.

        Args:
            name: the parameter's name.
            default: value where none is given; its type is the parameter's type. A list is one
                of strings.
            description: one sentence for ``ros2 param describe``.
            low: smallest allowed number.
            high: largest allowed number.
            read_only: whether it keeps the value that it has at the start.

        Raises:
            OccError: a value was given that has another type or is out of range.
        """
        if _described is not None:
            bounds = _range(low, high).strip()
            _described.append(DescribedParameter(name, _shown(default), description, bounds))
            return default
        descriptor = ParameterDescriptor(description=description, read_only=read_only)
        if low is not None or high is not None:
            if isinstance(default, int):
                bounds = IntegerRange(
                    from_value=-(2**62) if low is None else int(low),
                    to_value=2**62 if high is None else int(high),
                )
                descriptor.integer_range = [bounds]
            else:
                descriptor.floating_point_range = [
                    FloatingPointRange(
                        from_value=-_LARGEST if low is None else float(low),
                        to_value=_LARGEST if high is None else float(high),
                    )
                ]
        self._adapt_override(name, default)
        # rclpy takes an empty list for one of bytes, so a list of strings is declared by one.
        given = [''] if default == [] else default
        try:
            value = self.declare_parameter(name, given, descriptor).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            got = self._overrides[name].value
            raise ConfigurationError(
                f'parameter {name!r} of node {self.get_name()!r}: got {got!r}; allowed is '
                f'{_allowed(default, low, high)} ({description})'
            ) from error
        return [item for item in value if item] if isinstance(default, list) else value

    def declared(self) -> None:
        """Call it when all parameters are declared, before anything that has effects.

        Raises:
            OccError: a parameter was given to this node by name, or on its command line, that it
                does not have; rclpy would ignore it.
        """
        if _described is not None:
            raise _DescribedError
        self._check_given(qos=False)

    def check_qos(self) -> None:
        """Refuse overrides of quality of service for topics that the node does not have.

        Call it when the node is made.

        Raises:
            OccError: there is one.
        """
        self._check_given(qos=True)

    def _check_given(self, *, qos: bool) -> None:
        ignored = [
            name
            for name in self._overrides
            if name.startswith(_QOS_PREFIX) == qos and not self.has_parameter(name)
        ]
        if self.subscribes_later:
            ignored = [name for name in ignored if not _OF_SUBSCRIPTION.fullmatch(name)]
        _check_unknown(
            ignored,
            list(self.get_parameters_by_prefix('')),
            _command_line,
            self.get_fully_qualified_name(),
            self.get_logger().warning,
        )

    def _adapt_override(self, name: str, default: Any) -> None:
        override = self._overrides.get(name)
        if override is None:
            return
        if isinstance(default, float) and override.type_ == Parameter.Type.INTEGER:
            self._overrides[name] = Parameter(name, value=float(override.value))
        elif isinstance(default, list) and not override.value:
            # rclpy gives an empty list as no value at all.
            del self._overrides[name]
        elif isinstance(default, list) and override.type_ == Parameter.Type.STRING:
            self._overrides[name] = Parameter(name, value=[override.value])


def set_command_line(argv: Sequence[str]) -> None:
    """Set the arguments that the process was started with, before a node is made.

    Raises:
        OccError: a parameter file among them cannot be read.
    """
    global _command_line
    _command_line = list(argv)
    for path in _params_files(argv):
        read_text(path)


@contextmanager
def describing() -> Iterator[list[DescribedParameter]]:
    """Only describe the node that is made within the block, as far as it declares parameters.

    Yields:
        the parameters, in their order, once the block is over.
    """
    global _described
    described = _described = []
    try:
        yield described
        raise AssertionError('the node does not call `declared`')
    except _DescribedError:
        pass
    finally:
        _described = None


def _check_qos_overrides(overrides: Iterable[Parameter]) -> None:
    """Check the values of overrides of quality of service that a node may act on.

    Raises:
        OccError: one has a value that its policy does not take.
    """
    for item in overrides:
        match = _QOS.fullmatch(item.name)
        if match is None or match['policy'] not in _POLICIES:
            continue
        allowed, value = _POLICIES[match['policy']], item.value
        if allowed:
            if not isinstance(value, str) or value.lower() not in allowed:
                raise ConfigurationError(
                    f'parameter {item.name!r}: got {value!r}; allowed are {", ".join(allowed)}'
                )
            continue
        low, high, unit = _NUMBERS[match['policy']]
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise ConfigurationError(
                f'parameter {item.name!r}: got {value!r}; allowed is a whole number{unit} from '
                f'{low} up to {high}'
            )


def _check_unknown(
    ignored: Sequence[str],
    declared: Sequence[str],
    argv: Sequence[str],
    node: str,
    warn: Callable[[str], Any],
) -> None:
    """Refuse parameters that a node does not have, unless they may be meant for other nodes.

    Those of a section of a parameter file for any node (``/**``) may; of these, one that looks
    misspelled is warned of.

    Args:
        ignored: names that were given and that the node has not declared.
        declared: names that it has.
        argv: the command line with the parameters and the files of them.
        node: its full name.
        warn: called with a warning.

    Raises:
        OccError: one was given to this node by its name, or on its command line.
    """
    if not ignored:
        return
    ours = set(_of_command_line(argv))
    for path in _params_files(argv):
        ours |= set(names_of_sections(yaml.safe_load(read_text(path)), node))
    for name in ignored:
        hint, allowed = _similar(name, declared)
        if name in ours:
            raise ConfigurationError(
                f'node {node!r} has no parameter {name!r}{hint or ";"} allowed are {allowed}'
            )
        if hint:
            warn(f'parameter {name!r} is ignored: this node has no such parameter{hint}')


def _params_files(argv: Sequence[str]) -> Iterator[str]:
    """Yield the paths of the parameter files that a command line names."""
    for flag, value in zip(argv, argv[1:], strict=False):
        if flag == '--params-file':
            yield value


def _of_command_line(argv: Sequence[str]) -> Iterator[str]:
    for flag, value in zip(argv, argv[1:], strict=False):
        if flag in ('-p', '--param'):
            # NAME:=VALUE or NODE:NAME:=VALUE; those for other nodes are not among the ignored.
            yield value.partition(':=')[0].rpartition(':')[2]


def _similar(name: str, declared: Sequence[str]) -> tuple[str, str]:
    """Return the hint at a similar name, and in words what is allowed in place of ``name``."""
    qos = [item for item in declared if item.startswith(_QOS_PREFIX)]
    if not name.startswith(_QOS_PREFIX):
        known = [item for item in declared if item not in (*qos, *_ROS_SWITCHES)]
        return did_you_mean(name, (*known, *_ROS_SWITCHES)), ', '.join(known)
    if not qos:
        return '', 'none of quality of service'
    match = _QOS.fullmatch(name)
    own = [item for item in qos if match and item.startswith(name[: match.start('policy')])]
    policies = ', '.join(
        policy for policy in _POLICIES if any(item.endswith(f'.{policy}') for item in own or qos)
    )
    if match is not None and (own or match['policy'] not in _POLICIES):
        is_misspelled = match['policy'] not in (*_POLICIES, *_OTHER_POLICIES)
        hint = did_you_mean(match['policy'], _POLICIES) if is_misspelled else ''
        return hint, f'the policies {policies}'
    ends = sorted({item.rpartition('.')[0] for item in qos})
    hint = did_you_mean(name.rpartition('.')[0], ends)
    return hint, f'qos_overrides./TOPIC.publisher or .subscription, then {policies}'


def _allowed(default: Any, low: float | None, high: float | None) -> str:
    kind = {bool: 'true or false', int: 'a whole number', float: 'a number'}
    text = kind.get(type(default), 'text' if isinstance(default, str) else 'a list of texts')
    return text + _range(low, high)


def _range(low: float | None, high: float | None) -> str:
    return ('' if low is None else f' from {low:g}') + ('' if high is None else f' up to {high:g}')


def _shown(default: Any) -> str:
    """Return a default as it is written on a command line."""
    if isinstance(default, bool):
        return str(default).lower()
    return "['']" if default == [] else repr(default)
