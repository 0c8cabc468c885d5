"""The sound of a cradle as a phone records it: clicks at known instants, a room, music, speech and noise.

Nothing of the package is used. The modes of a steel ball of 40 mm lie above 60 kHz: what is heard is the pressure that
the sudden stop of the bobs radiates (Koss and Alfredson, J. Sound Vib. 27, 59, 1973), and the frame that rings.
"""

import numpy as np
from scipy.signal import fftconvolve, lfilter

#: Speed of sound [m/s], radius of a bob [m], and its contact time at 1 m/s [s]: Hertz, falling as v^(−1/5).
SOUND, RADIUS, CONTACT = 343.0, 0.02, 130e-6
#: Frequency [Hz], decay time [s] and strength of the modes of the frame, against the pressure pulse.
FRAME = ((2350.0, 1.1e-3, 0.20), (4120.0, 0.8e-3, 0.16), (6900.0, 0.5e-3, 0.12), (9800.0, 0.35e-3, 0.08))
#: Length of a click that is made [s], and samples of it per sample of the recording: clicks begin between samples.
LENGTH, FINE = 12e-3, 16


def click(speed, rate, late=0.0):
    """Pressure (K,) of an impact at a speed [m/s] that begins `late` samples after the first; of 1 m/s it peaks at
    about 1."""
    step = 1.0 / (rate * FINE)
    times = np.arange(int(LENGTH / step)) * step - late / rate
    contact = CONTACT * max(speed, 1e-4) ** -0.2
    pushed = np.where((times >= 0.0) & (times < contact), np.sin(np.pi * times / contact) * speed / contact, 0.0)
    w = SOUND / RADIUS  # a rigid sphere that is pushed rings at c/a, and stops within a/c
    radiated = np.where(times >= 0.0, np.exp(-w * times) * (np.cos(w * times) - np.sin(w * times)), 0.0)
    heard = pushed - w * step * fftconvolve(pushed, np.where(times >= 0.0, np.exp(-w * times), 0.0))[: len(times)]
    heard = heard + 0.3 * w * step * fftconvolve(pushed, radiated)[: len(times)]
    for frequency, decay, strength in FRAME:
        own = np.where(times >= 0.0, np.exp(-times / decay) * np.sin(2.0 * np.pi * frequency * times), 0.0)
        heard = heard + strength * 2.0 * np.pi * frequency * step * fftconvolve(pushed, own)[: len(times)]
    kernel = np.sinc(np.arange(-8 * FINE, 8 * FINE + 1) / FINE) * np.hanning(16 * FINE + 1)  # of the converter
    smooth = fftconvolve(heard, kernel / kernel.sum(), mode="same")
    return smooth[::FINE] / 1.1e4


def clicks(instants, speeds, rate, seconds):
    """Pressure (T,) of impacts at these instants [s] with these speeds [m/s]."""
    sound = np.zeros(int(seconds * rate) + 2 * int(LENGTH * rate))
    for instant, speed in zip(instants, speeds, strict=True):
        first = int(instant * rate)
        own = click(speed, rate, instant * rate - first)
        sound[first : first + len(own)] += own[: len(sound) - first]
    return sound[: int(seconds * rate)]


def room(sound, rate, rng, reverberation=0.4, strength=0.5):
    """The sound in a room: six early reflections in the first 25 ms, then noise that falls by 60 dB in
    `reverberation` [s]; strength: amplitude of the strongest reflection against the direct sound."""
    times = np.arange(int(1.2 * reverberation * rate)) / rate
    decay = 10.0 ** (-3.0 * times / reverberation)
    response = 0.02 * strength * rng.standard_normal(len(times)) * decay * (times > 0.008)
    response[0] = 1.0
    for delay in rng.uniform(0.002, 0.025, 6):
        response[int(delay * rate)] += (
            strength * rng.uniform(0.3, 1.0) * rng.choice([-1.0, 1.0]) * np.exp(-delay / 0.03)
        )
    return fftconvolve(sound, response)[: len(sound)]


def music(seconds, rate, rng):
    """Three voices of plucked and bowed notes with 16 harmonics, and a beat of muted drums; RMS 1."""
    sound = np.zeros(int(seconds * rate))
    for _ in range(3):
        start = rng.uniform(0.0, 0.5)
        while start < seconds:
            length = rng.choice([0.25, 0.5, 0.5, 1.0])
            times = np.arange(min(int(length * rate), len(sound) - int(start * rate))) / rate
            pitch = 110.0 * 2.0 ** (rng.integers(0, 36) / 12.0)
            attack, fall = rng.choice([0.005, 0.05]), rng.uniform(0.15, 0.8)
            envelope = (1.0 - np.exp(-times / attack)) * np.exp(-times / fall)
            for k in range(1, 17):
                if k * pitch < 0.45 * rate:
                    phase = rng.uniform(0.0, 2.0 * np.pi)
                    sound[int(start * rate) :][: len(times)] += (
                        envelope * np.sin(2 * np.pi * k * pitch * times + phase) / k
                    )
            start += length
    for beat in np.arange(rng.uniform(0.0, 0.5), seconds - 0.3, 0.5):
        times = np.arange(int(0.2 * rate)) / rate
        drum = np.sin(2 * np.pi * 60.0 * times) * np.exp(-times / 0.06)
        drum += 0.2 * lfilter([0.3], [1.0, -0.7], rng.standard_normal(len(times))) * np.exp(-times / 0.02)
        sound[int(beat * rate) :][: len(times)] += 3.0 * drum
    return sound / np.sqrt(np.mean(sound**2))


def speech(seconds, rate, rng):
    """Syllables of pulses through three formants, hisses, stops and pauses; RMS 1."""
    sound, now = np.zeros(int(seconds * rate)), 0.0
    while now < seconds - 0.5:
        length = rng.uniform(0.08, 0.25)
        n = int(length * rate)
        shape = np.hanning(n)
        kind = rng.choice(["vowel", "vowel", "hiss", "stop"])
        if kind == "vowel":
            pulses = np.zeros(n)
            pulses[np.cumsum(rng.normal(rate / rng.uniform(90, 220), 8.0, 60)).astype(int).clip(0, n - 1)] = 1.0
            own = lfilter([1.0], [1.0, -0.95], pulses)
            for formant in rng.uniform((300, 900, 2200), (800, 1900, 3200)):
                pole = np.exp(-np.pi * 90.0 / rate)
                turn = 2.0 * pole * np.cos(2.0 * np.pi * formant / rate)
                own = lfilter([1.0 - pole], [1.0, -turn, pole**2], own)
            own = shape * own / (np.abs(own).max() + 1e-12)
        elif kind == "hiss":
            own = 0.25 * shape * lfilter([1.0, -0.9], [1.0], rng.standard_normal(n))
        else:
            times = np.arange(n) / rate
            own = 0.3 * lfilter([0.4], [1.0, -0.6], rng.standard_normal(n)) * np.exp(-times / 0.006)
        sound[int(now * rate) :][:n] += own
        now += length + (rng.uniform(0.2, 0.7) if rng.random() < 0.2 else rng.uniform(0.0, 0.05))
    return sound / np.sqrt(np.mean(sound**2))


def hiss(seconds, rate, rng):
    """The noise of a room and a microphone: a rumble that falls with frequency, and white noise; RMS 1."""
    white = rng.standard_normal((2, int(seconds * rate)))
    sound = lfilter([0.03], [1.0, -0.97], white[0]) + 0.02 * white[1]
    return sound / np.sqrt(np.mean(sound**2))


BACKGROUNDS = {"hiss": hiss, "music": music, "speech": speech}


def record(instants, speeds, seconds, *, rate=48000, background="hiss", snr=30.0, reverberation=0.4, seed=0):
    """What a phone records, (T,), within ±1: impacts in a room over a background.

    snr: peak of the loudest click over the RMS of the background [dB]; hiss 40 dB below the peak is always there.
    """
    rng = np.random.default_rng(seed)
    sound = clicks(instants, speeds, rate, seconds)
    if reverberation:
        sound = room(sound, rate, rng, reverberation)
    peak = np.abs(sound).max()
    sound = sound + peak * 10.0 ** (-snr / 20.0) * BACKGROUNDS[background](seconds, rate, rng)
    if background != "hiss":
        sound = sound + 0.01 * peak * hiss(seconds, rate, rng)
    return 0.7 * sound / np.abs(sound).max()
