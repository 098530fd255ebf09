from hypothesis import settings

# On a busy machine a test may be slow once and fast the next time; how long tests may take is looked at as a whole.
settings.register_profile("any machine", deadline=None)
settings.load_profile("any machine")
