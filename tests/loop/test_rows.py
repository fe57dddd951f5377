"""An addition to the controller is one file or function and one row of a table: tested on a copy of the sources."""
import re
import shutil
import subprocess

LAW = "static void law_last(hrt_extrapolation *x, const moment *m, float force[3]) { (void)x, (void)m, (void)force; }\n"
EXTRAPOLATOR = """
#include "hrt.h"
#include <stdio.h>
int main(void) {
    hrt_extrapolator found;
    const bool known = hrt_extrapolator_find("last", &found);
    puts(HRT_EXTRAPOLATOR_CHOICE);
    puts(HRT_EXTRAPOLATOR_NAMES);
    return !(known && found == HRT_LAST && found == HRT_EXTRAPOLATOR_COUNT - 1);
}
"""
BUS = """
#include "bus.h"
static void close_mine(hrt_bus *bus) { bus->driver = NULL; }
static const hrt_bus_driver driver = {.name = "mine", .close = close_mine};
bool hrt_bus_mine(hrt_bus *bus, const char *name, char *why, int why_size) {
    (void)why, (void)why_size;
    bus->driver = &driver;
    return name[0] == 'x' && name[1] == 0;
}
"""
OPENS = """
#include "bus.h"
#include <stdio.h>
int main(void) {
    hrt_bus bus;
    char why[300];
    if (hrt_bus_open(&bus, "other:x", why, sizeof why)) return 1;
    puts(why);
    puts(HRT_BUS_ADDRESSES);
    return !hrt_bus_open(&bus, "mine:x", why, sizeof why);
}
"""


MESSAGE = """package tensormass;

struct weather_t {
    int64_t utime;
    int32_t seq;
    int64_t session;
    string  place;
    int32_t count;
    double  wind_m_s[count][2];
    int64_t tag;
}
"""
WEATHER = """
#include "link.h"
#include <stdio.h>
#include <string.h>
static int heard;
static app_verdict take(void *user, int instrument, int64_t utime, const void *message) {
    const tensormass_weather_t *m = message;
    (void)user, (void)utime;
    heard += instrument == 1 && m->count == 2 && m->wind_m_s[1][1] == 4.0 && strcmp(m->place, "theatre") == 0;
    return APP_TAKEN;
}
int main(void) {
    char place[] = "theatre";
    double a[] = {1, 2}, b[] = {3, 4}, *wind[] = {a, b};
    const tensormass_weather_t m = {.place = place, .count = 2, .wind_m_s = wind};
    const app_key key = {.known = true};
    const app_topic topic = {APP_WEATHER, 1, take, NULL};
    const app_link_def def = {.topic = &topic, .topics = 1, .key = &key}, keyless = {0};
    app_queue *queue = app_queue_create(0);
    app_link *one = app_link_join(queue, &def, NULL), *two = app_link_join(queue, &def, NULL), *three = app_link_join(queue, &keyless, NULL);
    app_link_publish(one, APP_WEATHER, 1, 0, &m);
    app_link_publish(three, APP_WEATHER, 1, 0, &m); /* without its seal */
    app_link_receive(two, 0, 10);
    app_link_give(two, "WEATHER_1", 0, "not whole", 9);
    printf("%s %d %d\\n", app_message_type(APP_WEATHER), app_message_max(APP_WEATHER), heard);
    return !(heard == 1 && app_link_counted(two)->forged == 2 && app_message_has_tag(APP_WEATHER));
}
"""


def insert(path, before, text):
    whole = path.read_text()
    assert whole.count(before) == 1, f"{path} holds {whole.count(before)} times, not once: {before}"
    path.write_text(whole.replace(before, text + before))


def lines_of(folder, main, sources, *flags):
    (folder / "main.c").write_text(main)
    program = folder / "main"
    run = subprocess.run(["cc", "-std=c11", "-D_GNU_SOURCE", "-O0", "-Werror", f"-I{folder}", f"-I{folder}/haptic_rt", f"-I{folder}/haptic_rt/core", f"-I{folder}/haptic_rt/io", *flags, "-o", program,
                          folder / "main.c", *sources, "-lm"], capture_output=True, text=True, timeout=400)
    assert run.returncode == 0, run.stderr
    run = subprocess.run([program], capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stdout
    return run.stdout.splitlines()


def test_an_extrapolator_is_a_law_and_a_row(root, tmp_path):
    core = tmp_path / "haptic_rt/core"
    shutil.copytree(root / "haptic_rt/core", core)
    for folder in ("contact_law", "libtensormass/numeric"):
        shutil.copytree(root / folder, tmp_path / folder)
    insert(core / "hrt.h", '    ROW(ADAPTIVE, "adaptive", law_off_patch)', '    ROW(ADAPTIVE, "adaptive", law_off_patch) \\\n')
    text = (core / "hrt.h").read_text()
    text, count = re.subn(r'    ROW\(ADAPTIVE, "adaptive", law_off_patch\) +/\*', '    ROW(LAST, "last", law_last) /*', text)
    assert count == 1
    (core / "hrt.h").write_text(text)
    insert(core / "extrapolate.c", "typedef struct law {", LAW)
    choice, names = lines_of(tmp_path, EXTRAPOLATOR, sorted(core.glob("*.c")))
    assert choice == "hold|time|position|broyden|tangent|local_model|paper_position|adaptive|last" and names.split() == choice.split("|")


def test_a_bus_is_a_file_and_a_row(root, tmp_path):
    for folder in ("io", "can", "core"):
        shutil.copytree(root / "haptic_rt" / folder, tmp_path / "haptic_rt" / folder)
    io = tmp_path / "haptic_rt/io"
    (io / "bus_mine.c").write_text(BUS)
    insert(io / "bus.h", '    ROW(socketcan, "INTERFACE", 2000)', '    ROW(mine, "LETTER", 1000) \\\n')
    why, addresses = lines_of(tmp_path, OPENS, sorted(io.glob("bus*.c")))
    assert why == "'other:x' is not a bus address; use virtual:NAME or mine:LETTER or socketcan:INTERFACE"
    assert addresses.split() == ["virtual:NAME", "mine:LETTER", "socketcan:INTERFACE"]


def test_a_message_is_its_type_and_a_row(root, tmp_path):
    """These alone encode it, check its bounds, authenticate it and pass it on."""
    types = tmp_path / "lcm_types"
    shutil.copytree(root / "lcm_types", types)
    (types / "weather_t.lcm").write_text(MESSAGE)
    insert(types / "message.h", "    ROW(FORCE, force_sample", '    ROW(WEATHER, weather, "WEATHER_", 1000) \\\n')
    shutil.copytree(root / "tools", tmp_path / "tools")
    shutil.copy(root / "Makefile", tmp_path)
    run = subprocess.run(["make", "-C", tmp_path, "config=release", "BUILD=out", "out/gen/lcm_types/tensormass.h"], capture_output=True, text=True, timeout=400)
    assert run.returncode == 0, run.stderr
    sources = [p for p in sorted(types.glob("*.c")) if p.stem not in ("link_network", "receiver", "receiver_lcm", "receiver_udpm")]
    generated = tmp_path / "out/gen/lcm_types"
    out = lines_of(tmp_path, WEATHER, [*sources, *sorted(generated.glob("*.c"))], f"-I{types}", f"-I{generated.parent}", f"-I{root}")
    assert out == ["weather_t 1000 1"]


def test_names_are_in_one_table(root):
    for folder in ("haptic_rt", "apps"):
        for path in sorted((root / folder).rglob("*.[ch]")):
            if path.name not in ("hrt.h", "extrapolate.c"):
                assert "paper_position" not in path.read_text(), path
