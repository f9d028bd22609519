"""Errors of apps outside this process, by the caller's possible reaction."""


class AppError(RuntimeError):
    """The app answered that it cannot do what was asked now; the app itself goes on."""


class AppTimeout(AppError):
    """No answer within the deadline: the app hangs, is stopped, or is not an app at all."""


class AppDied(AppError):
    """The app's process ended, or its end of the connection is gone."""


class ProtocolError(AppError):
    """The app's answer is none that the protocol knows."""


class AppUnsupported(AppError):
    """The app's protocol has no such request, for example saving in a Unity app."""


class AppRefused(ValueError):
    """A setting, option or pose that the app does not take; names it, got and expected."""


APP_FAILURES = (AppTimeout, AppDied, ProtocolError)
"""After one of these the app cannot be used any more: close it and start another."""
