"""Planning the feed profile window by window, with the planning methods behind one interface."""
