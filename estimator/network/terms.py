"""Heat that is known up to coefficients: terms of a network (the sun by facade, the habits of people).

Heat into node n at step k is, beside what a network measures, the sum of c_j f_j(k) over its terms j. f_j is known for
any time, past or planned (`estimator.heat`); the coefficients c_j are learned with the state (`estimator.mixture`).
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class HeatTerm:
    """Heat c f(t) into `node`: `series` names the known f, in W per `unit` of the coefficient c.

    A priori c ~ N(mean, sd^2); it stays at or above `lower` if that is given, and walks by `walk` per square root of a
    day.
    """

    name: str
    node: str
    series: str
    unit: str
    mean: float
    sd: float
    walk: float
    lower: float | None = None
