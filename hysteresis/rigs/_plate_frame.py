"""The frame below a cover: plates that sag where they are pressed, in many modes."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from ._arguments import check_fields


@dataclass(frozen=True, kw_only=True)
class PlateFrame:
    """Five thin plates, held at their edges; the lower edges of the four walls are free to move.

    A force at a point moves it by the sum over the modes of a simply supported plate (Navier),

        w/F = sum_mn phi_mn^2/K_mn,    phi_mn = sin(m pi x/a) sin(n pi y/b)
        K_mn = (a b/4) D pi^4 (m^2/a^2 + n^2/b^2)^2,     D = E t^3/(12 (1 - nu^2))

    A wall is half of a plate of twice its height, pressed with its mirror image: n is odd.

    **Arguments:** (all above 0)

    - `thickness_mm`, `modulus_gpa`, `poisson`: t, E and nu; acrylic glass unless given.
    - `modes`: in each direction.

    **Raises:** `InputError` if a parameter is outside its range.

    Source: Timoshenko and Woinowsky-Krieger, Theory of Plates and Shells (1959), section 34.
    """

    thickness_mm: float = 5.0
    modulus_gpa: float = 3.0
    poisson: float = 0.37
    modes: int = 8

    def __post_init__(self) -> None:
        check_fields(self, below={"poisson": 0.5})

    def compliance(
        self,
        place: Float[np.ndarray, "presses 2"],
        half: Float[np.ndarray, "presses 2"],
        wall: Bool[np.ndarray, " presses"],
    ) -> Float[np.ndarray, " presses"]:
        """w/F in mm/N at places in m from the middle of plates with these half widths.

        Of a wall the second coordinate is the height.
        """
        t, E = 1e-3 * self.thickness_mm, 1e9 * self.modulus_gpa
        D = E * t**3 / (12 * (1 - self.poisson**2))
        a, high = 2 * half.T
        x = place[:, 0] + half[:, 0]
        # From the upper edge downwards, so that the free edge is the middle of the doubled plate.
        y = np.where(wall, half[:, 1] - place[:, 1], place[:, 1] + half[:, 1])
        b = np.where(wall, 2 * high, high)
        m, n = np.mgrid[1 : self.modes + 1, 1 : self.modes + 1].reshape(2, -1, 1)
        shape = np.sin(m * np.pi * x / a) * np.sin(n * np.pi * y / b)
        K = a * b / 4 * D * np.pi**4 * ((m / a) ** 2 + (n / b) ** 2) ** 2
        return 1e3 * np.sum(np.where(wall, 2.0 * (n % 2), 1.0) * shape**2 / K, axis=0)
