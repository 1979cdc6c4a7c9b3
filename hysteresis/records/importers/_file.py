"""The bytes of a file and its text, or why there are none."""

from difflib import get_close_matches
from pathlib import Path

from ..._errors import InputError


def file_bytes(path: Path) -> bytes:
    """What is in a file.

    Raises `InputError` `is-directory`, `file-not-found`, `permission-denied`, `unreadable-file`,
    `empty-file`.
    """
    try:
        data = path.read_bytes()
    except IsADirectoryError:
        mend = "give a file that is in it."
        raise fault("is-directory", path, "this is a folder, not a file.", mend) from None
    except (FileNotFoundError, NotADirectoryError):
        folder = path.parent
        names = [p.name for p in folder.iterdir()] if folder.is_dir() else []
        near = ", ".join(get_close_matches(path.name, names, 3, 0.3)) or "nothing alike"
        where = f"nearest: {near}." if folder.is_dir() else "its folder does not exist."
        mend = "give the path of a file that exists, from the current folder or from the root."
        raise fault("file-not-found", path, f"not found; {where}", mend) from None
    except PermissionError:
        raise fault("permission-denied", path, "you may not read it.", "chmod +r FILE.") from None
    except OSError as error:
        problem = f"cannot be read: {error.strerror}."
        raise fault("unreadable-file", path, problem, "copy the file and read the copy.") from None
    if not data.strip():
        raise fault("empty-file", path, "the file is empty.", "export the data again.")
    return data


def fault(code: str, path: Path, problem: str, fix: str = "") -> InputError:
    """An error that concerns the whole file."""
    return InputError(code, problem, place=str(path), fix=fix)
