"""Clock, pace, run and record: the imperative shell around the pilot."""
