"""The page in a real browser: real mouse and key events, and the pixels of the canvas."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from contextlib import contextmanager

import pytest
from labelling_recordings import GREY, HEIGHT, PICTURES, STAMPS, WIDTH, serving, write_recording
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.keys import Keys
from selenium.webdriver.support.ui import WebDriverWait

from etd_ros.boxes import Box
from etd_ros.evaluation import read_boxes
from etd_ros.evaluation.truth import TimedBox

WAIT_S = 30
FLAGS = (
    "--headless --no-sandbox --disable-gpu --disable-quic --disable-dev-shm-usage --no-first-run "
    "--disable-background-networking --disable-component-update --disable-sync --window-size=1100,800"
)
YELLOW, BLUE = (255, 210, 63), (63, 193, 255)
"""Of the first two targets."""
PIXELS = """
const canvas = document.getElementById("picture"), area = canvas.getContext("2d");
return arguments[0].map(([x, y]) => [...area.getImageData(x, y, 1, 1).data.slice(0, 3)]);
"""


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    assert shutil.which("chromium"), "chromium is missing: `make browser` says how to get it"
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium")
    for flag in FLAGS.split():
        options.add_argument(flag)
    options.add_argument(f"--user-data-dir={tmp_path_factory.mktemp('browser')}")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))
    yield driver
    driver.quit()


class Page:
    """What a labeller does and sees."""

    def __init__(self, browser, url):
        self.browser = browser
        browser.get(url)
        self.until(lambda: "/" in self.text("time"))
        self.until(lambda: self.pixels([(0, 0)])[0] != (0, 0, 0))

    def until(self, condition):
        WebDriverWait(self.browser, WAIT_S, poll_frequency=0.05).until(lambda _: condition())

    def element(self, name):
        return self.browser.find_element("id", name)

    def text(self, name):
        return self.element(name).text

    @property
    def typed_class(self):
        """Of the first target; asked for at once, as its row is drawn anew with each answer."""
        return self.browser.execute_script("return document.querySelector('#targets li input.class').value")

    @property
    def zoom(self):
        return int(self.text("zoom").split()[0])

    def press(self, *keys, held=()):
        actions = ActionChains(self.browser)
        for key in held:
            actions.key_down(key)
        actions.send_keys(*keys)
        for key in held:
            actions.key_up(key)
        actions.perform()

    def drag(self, start, end, held=()):
        """Press, move and release the mouse; places in pixels of the picture."""
        area = self.browser.execute_script("return document.getElementById('picture').getBoundingClientRect().toJSON()")
        places = [start, ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2), end]
        points = [(round(area["x"] + x * self.zoom), round(area["y"] + y * self.zoom)) for x, y in places]
        keys = ActionChains(self.browser)
        for key in held:
            keys.key_down(key)
        keys.perform()
        mouse = ActionBuilder(self.browser, duration=20)
        mouse.pointer_action.move_to_location(*points[0]).pointer_down()
        for point in points[1:]:
            mouse.pointer_action.move_to_location(*point)
        mouse.pointer_action.pointer_up()
        mouse.perform()
        keys = ActionChains(self.browser)
        for key in held:
            keys.key_up(key)
        keys.perform()

    def draw(self, box, held=()):
        x, y, w, h = box
        self.drag((x, y), (x + w, y + h), held)

    def go(self, picture):
        self.press(Keys.HOME)
        for _ in range(picture):
            self.press(Keys.ARROW_RIGHT)
        self.until(lambda: self.text("time").startswith(f"{picture + 1} / {PICTURES}"))

    def here(self, words):
        self.until(lambda: words in self.text("here"))

    def pixels(self, places):
        return [tuple(pixel) for pixel in self.browser.execute_script(PIXELS, [list(place) for place in places])]

    def outline_share(self, box, colour=YELLOW):
        """How much of a box's outline on the canvas has the colour, its handles and name aside."""
        x, y, w, h = (value * self.zoom for value in box)
        steps = [0.2 + 0.6 * number / 59 for number in range(60)]
        places = [(round(x + share * w), round(y + h)) for share in steps]
        places += [(round(x), round(y + share * h)) for share in steps]
        places += [(round(x + w), round(y + share * h)) for share in steps]
        return sum(near(pixel, colour) for pixel in self.pixels(places)) / len(places)

    def save(self):
        self.press("s", held=[Keys.CONTROL])
        self.until(lambda: re.match(r"\d+ box(es)? of", self.text("message")))


def near(pixel, colour):
    return all(abs(one - two) < 40 for one, two in zip(pixel, colour, strict=True))


@contextmanager
def labelling(repository, recording, output):
    """The command as a process, and the page's address."""
    command = [sys.executable, "-m", "etd_ros", "label", str(recording), "--output", str(output), "--no-browser"]
    with subprocess.Popen(command, cwd=repository, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield process, re.search(r"http://\S+", process.stdout.readline())[0]
        finally:
            process.kill()


@pytest.fixture
def output(tmp_path):
    return tmp_path / "boxes.csv"


@pytest.fixture
def page(browser, tmp_path, output):
    with serving(write_recording(tmp_path / "a"), output) as server:
        yield Page(browser, server.url)
        errors = [entry["message"] for entry in browser.get_log("browser") if entry["level"] == "SEVERE"]
        browser.get("about:blank")
    assert errors == []


def test_two_key_frames_drawn_with_the_mouse_are_interpolated_shown_and_saved(page, output):
    page.draw((10, 20, 20, 16))
    page.here("x 10, y 20, w 20, h 16 (key frame)")
    page.go(4)
    page.here("no label")
    page.draw((50, 8, 28, 24))
    page.here("x 50, y 8, w 28, h 24 (key frame)")
    assert page.outline_share((50, 8, 28, 24)) > 0.9
    page.go(1)
    page.here("x 20, y 17, w 22, h 18 (interpolated)")
    # An interpolated box is dashed: 6 pixels of 10.
    assert 0.4 < page.outline_share((20, 17, 22, 18)) < 0.8
    assert page.outline_share((10, 20, 20, 16)) < 0.2
    page.save()
    assert read_boxes(output) == {
        "target_1": [
            TimedBox(STAMPS[0], Box(10, 20, 20, 16)),
            TimedBox(STAMPS[1], Box(20, 17, 22, 18)),
            TimedBox(STAMPS[2], Box(30, 14, 24, 20)),
            TimedBox(STAMPS[3], Box(40, 11, 26, 22)),
            TimedBox(STAMPS[4], Box(50, 8, 28, 24)),
        ]
    }


@pytest.mark.parametrize(("zoom_key", "steps"), [("0", 0), ("+", 2), ("-", 2), ("-", 5)])
def test_boxes_are_exact_to_the_pixel_whatever_the_zoom(page, zoom_key, steps):
    zooms = [1, 2, 3, 4, 5, 6, 8, 10, 12, 16]
    wanted = zooms.index(page.zoom) + (steps if zoom_key == "+" else -steps)
    page.press(*[zoom_key] * steps)
    page.until(lambda: page.zoom == zooms[wanted])
    page.draw((13, 17, 31, 23))
    page.here("x 13, y 17, w 31, h 23 (key frame)")
    assert page.outline_share((13, 17, 31, 23)) > 0.9


def test_the_picture_shown_is_that_of_its_number(page):
    for number in (0, 7, 3):
        page.go(number)
        places = [((2 * column + 0.5) * page.zoom, page.zoom * HEIGHT / 2) for column in range(PICTURES)]
        expected = [200 if column == number else GREY for column in range(PICTURES)]
        page.until(lambda: [pixel[0] for pixel in page.pixels(places)] == expected)  # noqa: B023 - awaited here


def test_a_box_is_moved_and_resized_within_the_picture(page):
    page.draw((20, 20, 20, 20))
    page.here("x 20, y 20, w 20, h 20")
    page.drag((30, 30), (35, 27))
    page.here("x 25, y 17, w 20, h 20")
    page.drag((45, 37), (50, 47))
    page.here("x 25, y 17, w 25, h 30")
    page.drag((37, 32), (79, 59))
    page.here("x 55, y 30, w 25, h 30")
    page.press(Keys.ARROW_LEFT, Keys.ARROW_UP, held=[Keys.ALT])
    page.here("x 54, y 29, w 25, h 30")


def test_the_last_box_is_taken_on_to_another_picture(page):
    page.draw((10, 10, 20, 20))
    page.here("(key frame)")
    page.go(5)
    page.here("drag the dotted box")
    page.drag((20, 20), (50, 30))
    page.here("x 40, y 20, w 20, h 20 (key frame)")


def test_there_is_no_label_where_the_target_is_not_visible(page, output):
    for picture in (0, 3, 6, 8):
        page.go(picture)
        page.draw((10 + picture, 10, 20, 20), held=[Keys.SHIFT])
        page.here(f"x {10 + picture}, y 10, w 20, h 20 (key frame)")
    page.go(4)
    page.press("h")
    page.here("key frame: not visible")
    assert page.outline_share((14, 10, 20, 20)) < 0.2
    page.save()
    assert [label.stamp_ns for label in read_boxes(output)["target_1"]] == [STAMPS[i] for i in (0, 1, 2, 3, 6, 7, 8)]


def test_targets_are_added_by_name_renamed_chosen_and_deleted(page, output):
    page.press("n")
    page.press("red ball", Keys.ENTER)
    page.here("red ball: no label")
    page.draw((10, 10, 20, 20))
    page.here("red ball: x 10")
    page.press("n")
    page.press("drone", Keys.ENTER)
    page.here("drone: no label")
    page.draw((50, 10, 20, 20))
    page.here("drone: x 50")
    assert page.outline_share((50, 10, 20, 20), BLUE) > 0.9
    page.press("1")
    page.here("red ball: x 10")
    page.drag((60, 20), (60, 20))
    page.here("drone: x 50")
    page.press(Keys.ARROW_RIGHT, Keys.ENTER)
    page.here("drone: x 50, y 10, w 20, h 20 (key frame)")
    name = page.browser.find_element("css selector", "#targets li:nth-child(2) input")
    name.click()
    name.send_keys(Keys.CONTROL, "a")
    name.send_keys("quadrotor", Keys.ENTER)
    page.here("quadrotor: x 50")
    page.browser.find_element("css selector", "#targets li:first-child button").click()
    page.until(lambda: len(page.browser.find_elements("css selector", "#targets li")) == 1)
    page.save()
    assert list(read_boxes(output)) == ["quadrotor"]


def test_a_box_drawn_before_the_answer_to_a_new_name_is_that_targets(page, output):
    page.browser.execute_script(
        """
        window.send = window.fetch.bind(window);
        const isReleased = new Promise((done) => { window.release = done; });
        window.fetch = (...request) => isReleased.then(() => window.send(...request));
        """
    )
    page.press("n")
    page.press("drone", Keys.ENTER)
    page.draw((10, 10, 20, 20))
    page.browser.execute_script("window.release()")
    page.here("drone: x 10, y 10, w 20, h 20 (key frame)")


def test_changes_are_undone_and_done_again(page):
    page.draw((10, 10, 20, 20))
    page.here("x 10")
    page.drag((20, 20), (40, 30))
    page.here("x 30")
    page.press("z", held=[Keys.CONTROL])
    page.here("x 10")
    page.press("z", held=[Keys.CONTROL])
    page.here("Draw a box to begin")
    page.press("z", held=[Keys.CONTROL, Keys.SHIFT])
    page.here("x 10")
    page.press("y", held=[Keys.CONTROL])
    page.here("x 30")
    page.press(Keys.DELETE)
    page.here("target_1: no label")


def test_what_a_target_is_can_be_typed_beside_its_name(page, output):
    page.draw((10, 10, 20, 20))
    page.here("target_1: x 10")
    page.browser.find_element("css selector", "#targets li input.class").click()
    page.press("person", Keys.ENTER)
    page.until(lambda: page.typed_class)
    page.save()
    assert [row.class_id for row in read_boxes(output)["target_1"]] == ["person"]
    page.press("z", held=[Keys.CONTROL])
    page.until(lambda: page.typed_class == "")


def test_key_frames_are_gone_to_and_removed(page):
    for picture in (2, 6):
        page.go(picture)
        page.draw((10 + picture, 10, 20, 20), held=[Keys.SHIFT])
        page.here(f"x {10 + picture}, y 10, w 20, h 20 (key frame)")
    page.press(",")
    page.until(lambda: page.text("time").startswith("3 / "))
    page.press(".")
    page.until(lambda: page.text("time").startswith("7 / "))
    page.press(Keys.DELETE)
    page.here("no label")


def test_playing_shows_all_boxes_to_the_last_picture(page):
    page.draw((10, 10, 20, 20))
    page.here("(key frame)")
    page.press(Keys.END)
    page.drag((20, 20), (50, 20))
    page.here("x 40, y 10, w 20, h 20 (key frame)")
    page.browser.execute_script(
        """
        document.getElementById("speed").value = "0.25";
        window.seen = new Set();
        const here = document.getElementById("here");
        new MutationObserver(() => window.seen.add(here.textContent)).observe(here, { childList: true });
        """
    )
    page.press(Keys.SPACE)
    page.until(lambda: page.text("play") == "Play" and page.text("time").startswith(f"{PICTURES} / "))
    seen = page.browser.execute_script("return [...window.seen]")
    assert any("interpolated" in text for text in seen), seen


def test_the_slider_and_the_timeline_seek(page):
    slider = page.element("slider")
    ActionChains(page.browser).move_to_element(slider).click().perform()
    page.until(lambda: page.text("time").startswith("6 / "))
    timeline = page.element("timeline")
    ActionChains(page.browser).move_to_element_with_offset(
        timeline, -timeline.rect["width"] / 2 + 9, 0
    ).click().perform()
    page.until(lambda: page.text("time").startswith("1 / "))


def test_a_closed_page_and_a_killed_program_lose_nothing(browser, repository, tmp_path, output):
    recording = write_recording(tmp_path / "a")
    with labelling(repository, recording, output) as (process, url):
        page = Page(browser, url)
        page.draw((10, 10, 20, 20))
        page.here("(key frame)")
        browser.get("about:blank")
        page = Page(browser, url)
        page.here("x 10, y 10, w 20, h 20 (key frame)")
        process.kill()
        process.wait()
        page.drag((20, 20), (40, 30))
        page.until(lambda: "The program has ended" in page.text("message"))
        page.here("x 10, y 10, w 20, h 20 (key frame)")
    with labelling(repository, recording, output) as (_, url):
        page = Page(browser, url)
        page.here("x 10, y 10, w 20, h 20 (key frame)")
        assert "goes on" in page.text("message")
        page.save()
        browser.get("about:blank")
    assert read_boxes(output) == {"target_1": [TimedBox(0, Box(10, 10, 20, 20))]}
    browser.get_log("browser")


def test_a_refused_change_is_said(page):
    for name in ("ball", "drone"):
        page.press("n")
        page.press(name, Keys.ENTER)
        page.here(f"{name}: no label")
    name = page.browser.find_element("css selector", "#targets li:nth-child(2) input")
    name.click()
    name.send_keys(Keys.CONTROL, "a")
    name.send_keys("ball", Keys.ENTER)
    page.until(lambda: "there is a target 'ball' already" in page.text("message"))
    page.browser.get_log("browser")


def test_the_picture_fills_the_page_by_whole_multiples(page):
    stage = page.element("stage").rect
    assert page.zoom == int(min(stage["width"] / WIDTH, stage["height"] / HEIGHT))
