"""State of the contact that is carried from one wrench of a stream to the next."""

from typing import Any, NamedTuple

from jaxtyping import Array, Bool, Float, Int

from ._contact import Contact


class Touch(NamedTuple):
    """What is known of the present contact, or of the last one.

    - `touching`: whether there is one.
    - `surface`, `place` (m): where, P^i; surface 0 before the first.
    - `time`: of the last sample with contact.
    - `cover`: the state of the material there.
    - `contact`: the last one told.
    """

    touching: Bool[Array, ""]
    surface: Int[Array, ""]
    place: Float[Array, "3"]
    time: Float[Array, ""]
    cover: Any
    contact: Contact
