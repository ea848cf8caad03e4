"""Pure estimators that know no boat."""
