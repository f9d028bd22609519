"""Who can use an app, and how hard it is: a population beside an app's targets."""
