# SPDX-License-Identifier: Apache-2.0
"""The parameters of a node: declared with meaning and range, checked, changed, told of."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Mapping, Sequence
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.parameter import Parameter

from calib_model.errors import ParameterError

Check = Callable[[Any], Any]
Changed = Callable[[Any], None]
OF_ROS = 'qos_overrides.'  # declared by rclpy only where a topic's publisher or subscriber asks
MOST_NAMED = 8  # of those that are near to nothing: a shared file may have dozens


def unheard(_: Any) -> None:
    """What a change does where only the parameters are asked for, as `--help` does: nothing."""


class Parameters:
    """Declares parameters on `node`, a Node or a Sheet, and returns what was given for them.

    One with a callback `changed` may be set while the node runs; the callback gets the value once
    it is checked and set. All others are read-only.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._checks: dict[str, Check] = {}
        self._changed: dict[str, Changed] = {}
        node.add_on_set_parameters_callback(self._on_set)
        node.add_post_set_parameters_callback(self._after_set)

    def text(self, name: str, default: str, about: str, changed: Changed | None = None) -> str:
        """A text."""
        return str(
            self._declared(name, default, ParameterDescriptor(description=about), str, changed)
        )

    def number(
        self,
        name: str,
        default: float,
        about: str,
        least: float,
        most: float,
        changed: Changed | None = None,
    ) -> float:
        """A number within bounds; `rate:=200` is one, though ROS tells it from 200.0.

        Raises:
            ParameterError: what was given is none.
        """
        descriptor = ParameterDescriptor(
            description=about,
            dynamic_typing=True,
            floating_point_range=[FloatingPointRange(from_value=least, to_value=most)],
        )

        def check(value: Any) -> float:
            return number_within(name, value, least, most)

        return float(self._declared(name, default, descriptor, check, changed))

    def whole(
        self,
        name: str,
        default: int,
        about: str,
        least: int,
        most: int,
        changed: Changed | None = None,
    ) -> int:
        """A whole number within bounds.

        Raises:
            ParameterError: what was given is none.
        """
        descriptor = ParameterDescriptor(
            description=about, integer_range=[IntegerRange(from_value=least, to_value=most)]
        )

        def check(value: Any) -> int:
            return int(number_within(name, value, least, most))

        return int(self._declared(name, default, descriptor, check, changed))

    def flag(self, name: str, default: bool, about: str, changed: Changed | None = None) -> bool:
        """Yes or no."""
        return bool(
            self._declared(name, default, ParameterDescriptor(description=about), bool, changed)
        )

    def wholes(self, name: str, about: str, changed: Changed | None = None) -> tuple[int, ...]:
        """Whole numbers; none where nothing is given."""
        kind, descriptor = Parameter.Type.INTEGER_ARRAY, ParameterDescriptor(description=about)
        return tuple(self._declared(name, kind, descriptor, _tuple, changed))

    def numbers(
        self, name: str, default: Sequence[float], about: str, changed: Changed | None = None
    ) -> tuple[float, ...]:
        """Numbers with a decimal point; none where nothing is given and no default."""
        descriptor = ParameterDescriptor(description=about)
        kind = list(default) or Parameter.Type.DOUBLE_ARRAY
        return tuple(self._declared(name, kind, descriptor, _tuple, changed))

    def texts(self, name: str, default: Sequence[str], about: str) -> tuple[str, ...]:
        """Texts; empty ones are left out, for ROS cannot tell of what kind an empty list is."""
        given = self._declared(
            name, list(default) or [''], ParameterDescriptor(description=about), _tuple, None
        )
        return tuple(str(text) for text in given if text)

    def given(self, name: str) -> bool:
        """Whether somebody gave a parameter at the start, be it its default."""
        return name in _given_to(self._node)

    def _declared(
        self,
        name: str,
        default: Any,
        descriptor: ParameterDescriptor,
        check: Check,
        changed: Changed | None,
    ) -> Any:
        descriptor.read_only = changed is None
        if descriptor.floating_point_range or descriptor.integer_range:
            value = self._ranged(name, default, descriptor, check)
        else:
            value = check(self._node.declare_parameter(name, default, descriptor).value)
        if changed is not None:
            self._checks[name], self._changed[name] = check, changed
        return value

    def _ranged(
        self, name: str, default: Any, descriptor: ParameterDescriptor, check: Check
    ) -> Any:
        """The range comes after the check, which says in our words what was expected."""
        plain = ParameterDescriptor(
            description=descriptor.description, dynamic_typing=descriptor.dynamic_typing
        )
        given = self._node.declare_parameter(name, default, plain)
        value = check(given.value)
        descriptor.type = given.type_.value
        self._node.set_descriptor(name, descriptor)
        return value

    def _on_set(self, given: Sequence[Parameter]) -> SetParametersResult:
        try:
            for parameter in given:
                self._checks.get(parameter.name, _any)(parameter.value)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _after_set(self, given: Sequence[Parameter]) -> None:
        for parameter in given:
            if parameter.name in self._changed:
                value = self._checks[parameter.name](parameter.value)
                self._changed[parameter.name](value)


def warn_of_unknown(node: Any) -> None:
    """One line of warning when `node`, all declared, was given parameters that it does not have.

    Not a refusal: a file for `/**` may hold those of other nodes.
    """
    given = _given_to(node)
    unknown = [
        name
        for name in sorted(given)
        if not node.has_parameter(name) and not name.startswith(OF_ROS)
    ]
    if unknown:
        known = sorted(node.get_parameters_by_prefix(''))
        node.get_logger().warning(_unknown_line(unknown, known))


def _given_to(node: Any) -> Mapping[str, Any]:
    """The parameters that were given to a node, declared or not."""
    given: Mapping[str, Any] = getattr(node, '_parameter_overrides', {})  # rclpy has no public word
    return given


def _unknown_line(unknown: Sequence[str], known: Sequence[str]) -> str:
    parts, rest = [], []
    for name in unknown:
        if near := get_close_matches(name, known, 1):
            parts.append(f'no parameter {name!r}: did you mean {near[0]!r}?')
        else:
            rest.append(repr(name))
    if rest:
        more = f' and {len(rest) - MOST_NAMED} more' if len(rest) > MOST_NAMED else ''
        kind = 'parameters' if len(rest) > 1 else 'parameter'
        parts.append(f'no {kind} {", ".join(rest[:MOST_NAMED])}{more}')
    return ' '.join(parts)


def _any(value: Any) -> Any:
    return value


def _tuple(value: Any) -> tuple[Any, ...]:
    return () if value is None else tuple(value)


class Proposal:
    """A node as it would be with other values: what is declared on it again has those."""

    def __init__(self, node: Any, given: Sequence[Parameter] = ()) -> None:
        self._node = node
        self._given = {parameter.name: parameter for parameter in given}
        self._parameter_overrides = _given_to(node)  # what was given is so as it would be

    def declare_parameter(self, name: str, _: Any, __: ParameterDescriptor) -> Parameter:
        """The proposed value, or the present one."""
        return self._given.get(name) or self._node.get_parameter_or(name)

    def set_descriptor(self, name: str, descriptor: ParameterDescriptor) -> None:
        """It has one."""

    def add_on_set_parameters_callback(self, _: object) -> None:
        """The node has them."""

    def add_post_set_parameters_callback(self, _: object) -> None:
        """The node has them."""


class Sheet:
    """Takes declarations in a node's place and tells of them; every parameter has its default."""

    def __init__(self) -> None:
        self._noted: dict[str, tuple[str, ParameterDescriptor]] = {}

    def declare_parameter(
        self, name: str, default: Any, descriptor: ParameterDescriptor
    ) -> Parameter:
        """Note the parameter down."""
        unset = isinstance(default, Parameter.Type)
        self._noted[name] = '' if unset else f' ({default!r})', descriptor
        return Parameter(name, value=None if unset else default)

    def set_descriptor(self, name: str, descriptor: ParameterDescriptor) -> None:
        """Note down what is known better now."""
        self._noted[name] = self._noted[name][0], descriptor

    def add_on_set_parameters_callback(self, _: object) -> None:
        """Nothing is ever set here."""

    def add_post_set_parameters_callback(self, _: object) -> None:
        """Nothing is ever set here."""

    def text(self) -> str:
        """Name, default and meaning of every parameter."""
        if not self._noted:
            return 'It has no parameters.'
        lines = ['parameters, with their defaults, each given as -p NAME:=VALUE after --ros-args:']
        for name, (default, descriptor) in self._noted.items():
            lines += [f'  {name}{default}', _about(descriptor)]
        return '\n'.join(lines)


def _about(descriptor: ParameterDescriptor) -> str:
    about = str(descriptor.description)
    for bounds in (*descriptor.floating_point_range, *descriptor.integer_range):
        about += f'; from {bounds.from_value:g} to {bounds.to_value:g}'
    if not descriptor.read_only:
        about += '; may be set while the node runs'
    return textwrap.fill(about, 100, initial_indent='      ', subsequent_indent='      ')


def number_within(name: str, value: object, least: float, most: float) -> float:
    """A parameter's number.

    Raises:
        ParameterError: no number, or not from `least` to `most`.
    """
    number = isinstance(value, int | float) and not isinstance(value, bool)
    if not isinstance(value, int | float) or not number or not least <= value <= most:
        raise ParameterError(
            f"parameter '{name}': expected a number from {least:g} to {most:g}, got {value!r}"
        )
    return float(value)
