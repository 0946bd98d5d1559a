"""Compile the firmware's sketches for this machine, and run them on a pseudo-terminal."""

import os
import shutil
import subprocess
from contextlib import contextmanager
from pathlib import Path

import pytest

FIRMWARE = Path(__file__).resolve().parents[2] / "scripts" / "firmware"

needs_compiler = pytest.mark.skipif(shutil.which("g++") is None, reason="there is no g++")

STRICT = ("-std=c++11", "-O1", "-Wall", "-Wextra", "-Werror")

ARDUINO = """
#pragma once
#include <stddef.h>
#include <stdint.h>
const uint8_t A0 = 14, A1 = 15, A2 = 16, A14 = 40, A21 = 66, DAC0 = 67;
uint32_t micros();
int analogRead(uint8_t pin);
void analogReadResolution(int bits);
void analogReadAveraging(unsigned samples);
void analogWrite(uint8_t pin, int value);
void analogWriteResolution(int bits);
struct Port {
  void begin(uint32_t baud);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *bytes, size_t count);
  void send_now();
};
extern Port Serial;
"""

BOARD = """
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>
#include SKETCH
Port Serial;
static int line;
static FILE *out;
static uint8_t waiting[256];
static int first = 0, last = 0;
uint32_t micros() {
  timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return static_cast<uint32_t>(now.tv_sec * 1000000ull + now.tv_nsec / 1000);
}
int analogRead(uint8_t pin) { return READING; }
void analogReadResolution(int) {}
void analogReadAveraging(unsigned) {}
void analogWrite(uint8_t, int value) {
  const int16_t code = static_cast<int16_t>(value);
  fwrite(&code, sizeof code, 1, out);
}
void analogWriteResolution(int) {}
void Port::begin(uint32_t) {}
int Port::available() {
  if (first == last) {
    const ssize_t got = ::read(line, waiting, sizeof waiting);
    first = 0;
    last = got > 0 ? static_cast<int>(got) : 0;
  }
  return last - first;
}
int Port::read() { return available() > 0 ? waiting[first++] : -1; }
int Port::availableForWrite() { return 256; }
size_t Port::write(const uint8_t *bytes, size_t count) {
  const ssize_t sent = ::write(line, bytes, count);
  return sent > 0 ? static_cast<size_t>(sent) : 0;
}
void Port::send_now() {}
int main(int, char **words) {
  line = atoi(words[1]);
  out = fopen(words[2], "wb");
  fcntl(line, F_SETFL, O_NONBLOCK);
  fcntl(0, F_SETFL, O_NONBLOCK);
  setup();
  char byte;
  while (::read(0, &byte, 1) != 0) {  // until standard input ends
    loop();
    usleep(200);
  }
  return fclose(out);
}
"""


def compiled(source, directory, *words):
    """Return the program of a C++ source that may include what lies in the directory."""
    (directory / "program.cpp").write_text(source)
    program = directory / "program"
    subprocess.run(
        ["g++", *STRICT, *words, "-I", directory, directory / "program.cpp", "-o", program],
        check=True,
        timeout=150,
    )
    return program


def answers_of(program, lines):
    """Give a program these lines; return those that it answers."""
    text = "\n".join(lines)
    done = subprocess.run(
        [program], input=text, capture_output=True, text=True, check=True, timeout=150
    )
    return done.stdout.splitlines()


def check_whole(sketch, directory, *macros):
    """Compile a sketch as for the board of these macros, without a program."""
    (directory / "Arduino.h").write_text(ARDUINO)
    words = ["-fsyntax-only", *(f"-D{macro}" for macro in macros)]
    words += ["-I", directory, "-x", "c++", sketch]
    subprocess.run(["g++", *STRICT, *words], check=True, timeout=150)


class RunningSketch:
    """A sketch that runs as a process."""

    def __init__(self, process, path, out):
        self.path = path
        """Of its serial port."""
        self._process = process
        self._out = out

    def stop(self):
        """End it; its port is gone."""
        self._process.stdin.close()
        assert self._process.wait(10.0) == 0

    def put_out(self):
        """Return what went to the converter, as i16, once it was stopped."""
        return self._out.read_bytes()


@contextmanager
def running(sketch, directory, board, reading="0"):
    """Run a sketch; `reading` is what its converter reads, in C++ of `pin`."""
    import tty

    (directory / "Arduino.h").write_text(ARDUINO)
    words = [f"-D{board}", f'-DSKETCH="{sketch}"', f"-DREADING=(static_cast<void>(pin), {reading})"]
    program = compiled(BOARD, directory, *words)
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    out = directory / "converter"
    process = subprocess.Popen(
        [program, str(ours), str(out)], stdin=subprocess.PIPE, pass_fds=[ours]
    )
    os.close(ours)
    made = RunningSketch(process, os.ttyname(theirs), out)
    try:
        yield made
    finally:
        os.close(theirs)
        process.kill()
        process.wait(60.0)
        process.stdin.close()
