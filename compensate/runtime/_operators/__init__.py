"""Elements that are parts of others or need a search: a dead band, a first state, the Bouc-Wen model."""
