"""The autopilot command: one module per subcommand."""
