"""The sections of config.json, field by field."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (  # noqa: TID253 - loaded only to read a config
    BaseModel,
    ConfigDict,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)
from pydantic_core import PydanticCustomError

from openprc.schema.experiment import whole_multiple

Positive = Annotated[float, Field(gt=0)]
NonNegative = Annotated[float, Field(ge=0)]
Share = Annotated[float, Field(gt=0, lt=1)]


class _Section(BaseModel):
    # Strict: "0.1" is not a number and 1 is not a switch; a guess would hide a mistake.
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


class SimulationSection(_Section):
    """How long, how finely, and with which scheme."""

    # Before dt and integrator, which may be left out where this is given.
    accuracy: Share | None = Field(
        default=None,
        description="rms error of positions over rms displacement, which integrator and step are"
        " chosen for",
    )
    duration: NonNegative = Field(description="simulated time [s], a multiple of save_interval")
    dt: Positive | None = Field(
        default=None, validate_default=True, description="time step of the integrator [s]"
    )
    save_interval: Positive = Field(description="time between saved frames [s], a multiple of dt")
    integrator: str | None = Field(default=None, min_length=1, description="name of the integrator")
    tolerance: Positive | None = Field(
        default=None, description="relative error per step of integrators that choose their step"
    )
    constraint_tolerance: Positive | None = Field(
        default=None, description="largest relative violation of a rigid element"
    )
    precision: Literal["float64", "float32"] = Field(
        default="float64", description="floating-point format of the state"
    )
    step_check: Literal["refuse", "warn"] = Field(
        default="refuse", description="what happens when dt is above the stability limit"
    )

    @field_validator("dt", mode="after")
    @classmethod
    def _step_unless_chosen(cls, value: float | None, info: ValidationInfo) -> float | None:
        # Where accuracy itself is wrong, it is not among the data, and one message is enough.
        if value is None and info.data.get("accuracy", 1.0) is None:
            raise PydanticCustomError("missing", "Field required")
        return value

    @field_validator("integrator", mode="before")
    @classmethod
    def _named(cls, value: object) -> object:
        if value is None:
            raise PydanticCustomError("named", "Input should be a valid string")
        return value

    @model_validator(mode="after")
    def _commensurate(self) -> SimulationSection:
        for name, total, part_name, part in (
            ("save_interval", self.save_interval, "dt", self.dt),
            ("duration", self.duration, "save_interval", self.save_interval),
        ):
            if part is None:
                continue
            count = whole_multiple(total, part)
            if count is None or (count == 0 and name == "save_interval"):
                nearest = max(round(total / part), 1)
                raise PydanticCustomError(
                    "multiple",
                    "{text}",
                    {
                        "field": name,
                        "text": f"{total:g} s is {total / part:.6g} times {part_name} = {part:g} s"
                        f"; expected a whole multiple, such as {nearest * part:.12g} s",
                    },
                )
        return self


class PhysicsSection(_Section):
    """What acts on every node."""

    gravity: float | tuple[float, float, float] = Field(
        default=0.0,
        description="acceleration [m/s2]: along z when one number (-9.81 is down), or [x, y, z]",
    )
    damping: NonNegative = Field(
        default=0.0,
        description="drag: node i feels -c_i v_i with c_i = damping * m_i / mean(m) [kg/s]; "
        "the mean is over nodes with mass",
    )
    bar_damping: Literal["axial", "printed"] = Field(
        default="axial",
        description="axial: on the rate of the length; printed: -2 zeta sqrt(m_i k) (v_i - v_j)",
    )
    enable_collision: bool = Field(
        default=False, description="nodes marked collidable repel each other"
    )
    collision_radius: Positive | None = Field(default=None, description="radius of a node [m]")
    collision_restitution: Annotated[float, Field(ge=0, le=1)] | None = Field(
        default=None, description="ratio of normal speeds after and before an impact"
    )
    collision_iterations: Annotated[int, Field(ge=1)] | None = Field(
        default=None, description="sweeps over the contacts in one step"
    )
    collision_friction: NonNegative | None = Field(
        default=None, description="Coulomb's coefficient of friction"
    )
    collision_faces: bool = Field(
        default=False, description="collidable nodes touch faces that they are not part of"
    )

    @field_validator("gravity", mode="before")
    @classmethod
    def _list_to_vector(cls, value: object) -> object:
        return tuple(value) if isinstance(value, list) else value

    def gravity_vector(self) -> tuple[float, float, float]:
        """Return the acceleration as (x, y, z) [m/s2]."""
        if isinstance(self.gravity, tuple):
            return self.gravity
        return (0.0, 0.0, self.gravity)


class ActuatorSection(_Section):
    """One signal that drives one node along some axes."""

    node: Annotated[int, Field(ge=0)] = Field(description="index of the driven node")
    signal: Annotated[str, Field(min_length=1)] = Field(description="name of a signal")
    type: Literal["position", "force", "velocity"] = Field(
        description="position: absolute coordinates [m]; force [N]; velocity [m/s]"
    )
    axes: tuple[bool, bool, bool] = Field(
        default=(True, True, True), description="which of x, y, z are driven"
    )

    @field_validator("axes", mode="before")
    @classmethod
    def _list_to_axes(cls, value: object) -> object:
        return tuple(value) if isinstance(value, list) else value

    @field_validator("axes", mode="after")
    @classmethod
    def _some_axis(cls, value: tuple[bool, bool, bool]) -> tuple[bool, bool, bool]:
        if not any(value):
            raise PydanticCustomError("axes", "no axis is enabled; expected at least one")
        return value


class ExportSection(_Section):
    """What becomes of the result."""

    overwrite: bool = Field(
        default=False, description="a new run may replace the finished result of an earlier one"
    )
    precision: Literal["float64", "float32"] = Field(
        default="float64", description="of what is stored about nodes and elements"
    )
    velocities: bool = Field(default=True, description="velocities are stored")
    elements: bool = Field(default=True, description="lengths, forces, angles, ... are stored")


class Config(_Section):
    """The whole of config.json."""

    openprc_config: Annotated[str, Field(pattern=r"^\d+\.\d+$")] = Field(
        description="version of this layout, MAJOR.MINOR"
    )
    simulation: SimulationSection
    physics: PhysicsSection = PhysicsSection()
    actuators: tuple[ActuatorSection, ...] = ()
    export: ExportSection = ExportSection()

    @field_validator("actuators", mode="before")
    @classmethod
    def _list_to_tuple(cls, value: object) -> object:
        return tuple(value) if isinstance(value, list) else value
