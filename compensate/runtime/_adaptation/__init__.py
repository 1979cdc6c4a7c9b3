"""Elements that change while they run, written as those of `compensate.runtime._elements` are."""
