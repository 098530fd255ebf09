"""What each command does. These modules are imported when a command is called, not when it is described."""
