"""Figures and the HTML report (extra: norrbin[report])."""
