#!/usr/bin/python3
"""display.py COMMAND...: runs COMMAND with a display that can be reached from a network namespace.

In a namespace of its own a window finds its display by the file /tmp/.X11-unix/XN alone. `ssh -X` makes none: DISPLAY is localhost:N there, a port of the
machine's network. Then such a file is made here, outside of the namespace, and what comes through it is carried to the port; the cookie is taken along.
Where there is such a file, or Wayland alone, COMMAND is run as it is. Exit 2, with what to do: the display does not answer.
"""
import os
import pathlib
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import threading

SOCKETS = pathlib.Path("/tmp/.X11-unix")


def refuse(message):
    print(f"display: {message}", file=sys.stderr)
    sys.exit(2)


def parse(name):
    """Returns (host, number, screen) of a DISPLAY; host "" is this machine's socket. None: not of this form."""
    found = re.fullmatch(r"(?P<host>.*?):(?P<number>\d+)(?P<screen>\.\d+)?", name)
    if not found:
        return None
    host = found["host"]
    return "" if host == "unix" or host.endswith("/unix") else host.strip("[]"), int(found["number"]), found["screen"] or ""


def reach(host, number):
    """Returns a connection to the display from this network, or raises OSError."""
    if host:
        return socket.create_connection((host, 6000 + number), timeout=5)
    link = socket.socket(socket.AF_UNIX)
    try:
        link.connect(f"\0{SOCKETS}/X{number}")  # abstract socket of this network namespace, unlike a file
    except OSError:
        link.close()
        raise
    return link


def has_file(number):
    with socket.socket(socket.AF_UNIX) as link:
        try:
            link.connect(f"{SOCKETS}/X{number}")
        except OSError:
            return False
        return True


def pump(source, sink):
    try:
        while data := source.recv(65536):
            sink.sendall(data)
    except OSError:
        pass
    try:
        sink.shutdown(socket.SHUT_WR)
    except OSError:
        pass


def serve(listener, host, number):
    while True:
        try:
            near = listener.accept()[0]
        except OSError:
            return  # closed: COMMAND has ended
        try:
            far = reach(host, number)
        except OSError:
            near.close()
            continue
        far.settimeout(None)
        for pair in ((near, far), (far, near)):
            threading.Thread(target=pump, args=pair, daemon=True).start()


def listen(preferred):
    """Returns a listening socket with an unused number."""
    SOCKETS.mkdir(mode=0o1777, exist_ok=True)
    for number in (preferred, *range(200, 300)):
        listener = socket.socket(socket.AF_UNIX)
        try:
            listener.bind(f"{SOCKETS}/X{number}")
        except OSError:
            listener.close()
            continue
        os.chmod(f"{SOCKETS}/X{number}", 0o600)
        listener.listen(16)
        return number, listener
    return refuse(f"no file can be made in {SOCKETS}; make that folder writable (chmod 1777 {SOCKETS})")


def cookie(display, number, folder):
    """Returns a file with the display's cookie under its new number. None: there is no cookie, or no program that reads it."""
    if not shutil.which("xauth"):
        return None
    told = subprocess.run(["xauth", "nlist", display], capture_output=True, text=True).stdout.split()
    if len(told) < 9:
        return None
    digits = str(number)
    entry = ["ffff", *told[1:3], f"{len(digits):04x}", digits.encode().hex(), *told[5:9]]  # for any host
    path = pathlib.Path(folder) / "Xauthority"
    subprocess.run(["xauth", "-q", "-f", path, "nmerge", "-"], input=" ".join(entry) + "\n", text=True, stderr=subprocess.DEVNULL)
    return path


def run(command, environment):
    child = subprocess.Popen(command, env=environment)
    signal.signal(signal.SIGINT, lambda *_: None)  # of the terminal: COMMAND receives it too
    for number in (signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda n, _: child.send_signal(n))
    code = child.wait()
    return 128 - code if code < 0 else code


def main():
    command, display = sys.argv[1:], os.environ.get("DISPLAY", "")
    if not command or command[0] in ("-h", "--help"):
        print(__doc__.strip())
        return 0 if command else 2
    place = parse(display)
    if not display or (place and not place[0] and has_file(place[1])):
        os.execvp(command[0], command)
    if not place:
        refuse(f"DISPLAY is '{display}', which is not a display; set it to a value such as :0 or localhost:10.0")
    host, wanted, screen = place
    try:
        reach(host, wanted).close()
    except OSError as why:
        refuse(f"the display '{display}' does not answer ({why.strerror or why}); log in again with ssh -X, or run it on a desktop")
    number, listener = listen(wanted)
    try:
        with tempfile.TemporaryDirectory(prefix="tensormass-display-") as folder:
            threading.Thread(target=serve, args=(listener, host, wanted), daemon=True).start()
            environment = {**os.environ, "DISPLAY": f":{number}{screen}"}
            authority = cookie(display, number, folder)
            if authority:
                environment["XAUTHORITY"] = str(authority)
            return run(command, environment)
    finally:
        (SOCKETS / f"X{number}").unlink(missing_ok=True)
        listener.close()


if __name__ == "__main__":
    sys.exit(main())
