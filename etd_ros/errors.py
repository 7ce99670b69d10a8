"""The root of the package's errors: what a user can mend, said in one line."""


class EtdError(Exception):
    """Bad input. The message names what is wrong, where, and what to do about it.

    Every area derives one class from this one; the command line prints the message and exits with 2,
    the nodes warn and count it.
    """
