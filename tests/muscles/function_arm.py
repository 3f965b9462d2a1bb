"""An arm of three links whose muscles have lengths by functions, as a document of OpenSim."""

from __future__ import annotations

LENGTHS = {
    "two": (
        "<MultivariatePolynomialFunction><coefficients>0.4 -0.03 0.01 0.02 -0.05 0.013"
        "</coefficients><dimension>2</dimension><order>2</order></MultivariatePolynomialFunction>"
    ),
    "linear": "<LinearFunction><coefficients>-0.03 0.02 0.35</coefficients></LinearFunction>",
}
ONE = {
    "polynomial": (
        "<PolynomialFunction><coefficients>0.003 -0.01 -0.02 0.3</coefficients>"
        "</PolynomialFunction>"
    ),
    "spline": "<SimmSpline><x>-1 0 1 2</x><y>0.3 0.31 0.33 0.32</y></SimmSpline>",
    "sine": "<Sine><amplitude>0.02</amplitude><omega>1.1</omega><phase>0.3</phase>"
    "<offset>0.3</offset></Sine>",
    "multiplied": "<MultiplierFunction><function><LinearFunction><coefficients>0.02 0.3"
    "</coefficients></LinearFunction></function><scale>1.5</scale></MultiplierFunction>",
}


def function_arm(paths: dict[str, str], coupler: str = "") -> str:
    """Write a document of three links with three coordinates and a muscle for each path."""
    joints = "".join(
        f'<PinJoint name="{name}"><socket_parent_frame>{parent}</socket_parent_frame>'
        f"<socket_child_frame>{name}_c</socket_child_frame><coordinates><Coordinate "
        f'name="{name}_angle"><range>-2 2</range></Coordinate></coordinates><frames>'
        f'<PhysicalOffsetFrame name="{name}_c"><socket_parent>/bodyset/{child}</socket_parent>'
        "<translation>0 0.3 0</translation></PhysicalOffsetFrame></frames></PinJoint>"
        for name, parent, child in (
            ("shoulder", "/ground", "upper"),
            ("elbow", "/bodyset/upper", "fore"),
            ("wrist", "/bodyset/fore", "hand"),
        )
    )
    bodies = "".join(
        f'<Body name="{name}"><mass>{mass}</mass><mass_center>0 -0.1 0</mass_center>'
        "<inertia>0.01 0.01 0.01 0 0 0</inertia></Body>"
        for name, mass in (("upper", 2.0), ("fore", 1.3), ("hand", 0.5))
    )
    muscles = "".join(
        f'<Millard2012EquilibriumMuscle name="{name}"><max_isometric_force>900'
        "</max_isometric_force><optimal_fiber_length>0.15</optimal_fiber_length>"
        f"<tendon_slack_length>0.18</tendon_slack_length>{path}</Millard2012EquilibriumMuscle>"
        for name, path in paths.items()
    )
    return (
        '<?xml version="1.0"?><OpenSimDocument Version="40600"><Model name="arm">'
        f'<BodySet name="bodyset"><objects>{bodies}</objects></BodySet>'
        f'<JointSet name="jointset"><objects>{joints}</objects></JointSet>'
        f'<ConstraintSet name="constraintset"><objects>{coupler}</objects></ConstraintSet>'
        f'<ForceSet name="forceset"><objects>{muscles}</objects></ForceSet></Model>'
        "</OpenSimDocument>"
    )


def function_path(length: str, *joints: str, more: str = "") -> str:
    """Write a path of a muscle over joints."""
    names = " ".join(f"/jointset/{joint}/{joint}_angle" for joint in joints)
    return (
        f'<FunctionBasedPath name="path"><coordinate_paths>{names}</coordinate_paths>'
        f"<length_function>{length}</length_function>{more}</FunctionBasedPath>"
    )


PATHS = {
    **{f"{key}_muscle": function_path(text, "elbow", "shoulder") for key, text in LENGTHS.items()},
    **{f"{key}_muscle": function_path(text, "elbow") for key, text in ONE.items()},
}
COUPLER = (
    '<CoordinateCouplerConstraint name="follows"><coupled_coordinates_function><PolynomialFunction>'
    "<coefficients>0.2 0.5 0.1</coefficients></PolynomialFunction></coupled_coordinates_function>"
    "<independent_coordinate_names>elbow_angle</independent_coordinate_names>"
    "<dependent_coordinate_name>wrist_angle</dependent_coordinate_name>"
    "</CoordinateCouplerConstraint>"
)
