"""A node's parameter as ROS describes it."""

from __future__ import annotations

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor

from stage_core.parameters import Parameter


def descriptor(parameter: Parameter) -> ParameterDescriptor:
    """ROS descriptor of a parameter, with its unit and its range where it has one."""
    text = parameter.description + (f' [{parameter.unit}]' if parameter.unit else '')
    result = ParameterDescriptor(
        name=parameter.name, description=text, read_only=parameter.read_only
    )
    if parameter.choices:
        result.additional_constraints = 'one of ' + ', '.join(parameter.choices)
    low, high = parameter.minimum, parameter.maximum
    if low is None and high is None or isinstance(parameter.default, (str, bool, list)):
        return result
    if isinstance(parameter.default, float):
        result.floating_point_range = [
            FloatingPointRange(
                from_value=-1e308 if low is None else float(low),
                to_value=1e308 if high is None else float(high),
                step=0.0,
            )
        ]
    else:
        result.integer_range = [
            IntegerRange(
                from_value=-(2**62) if low is None else int(low),
                to_value=2**62 if high is None else int(high),
                step=1,
            )
        ]
    return result
