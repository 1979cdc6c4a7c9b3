from typing import Any
Tree = dict[str, Any]
