# The Python package (docs/python.md). Nothing else depends on it: only `make wheel` and its tests build it.
PYTHON_LIB := $(OUT)/python-lib
PYTHON_SHARED := tensormass tensormass_io tensormass_solve tensormass_scene
PYTHON_LIBRARIES := $(PYTHON_SHARED:%=$(PYTHON_LIB)/lib%.so.$(SOVERSION)) $(PYTHON_LIB)/libtensormass_controller.so
$(PYTHON_LIB)/%.so.$(SOVERSION): $(OUT)/lib/%.so.$(VERSION)
	$(call step,COPY)
	$(Q)cp $< $@
# The controller's core, with exported functions.
$(OUT)/obj/python/%.o: %.c Makefile
	$(call step,CC)
	$(Q)$(CC) $(BASE_CFLAGS) -fvisibility=default $(INCLUDES) -c $< -o $@
$(PYTHON_LIB)/libtensormass_controller.so: $(patsubst %.c,$(OUT)/obj/python/%.o,$(call files,haptic_rt/core/*.c))
	$(call step,LINK)
	$(Q)$(CC) $(SAN) -shared -Wl,-soname,$(@F) -o $@ $^ -lm
# Headers that the package calls, by library, and their folders.
PYTHON_HEADERS := tensormass=libtensormass/include/tensormass.h tensormass_io=libtensormass/io/include/tensormass_io.h \
	tensormass_solve=libtensormass/include/tensormass_solve.h \
	tensormass_controller=haptic_rt/core/hrt.h tensormass_scene=libtensormass/scene/include/tensormass_scene.h
PYTHON_INCLUDES := libtensormass/include libtensormass/io/include libtensormass/scene/include haptic_rt/core
$(OUT)/wheel/venv/.done: python/requirements.txt
PYTHON_WHEEL = python/wheel.sh $(OUT) $(abspath $(OUT)/wheel/venv)/bin/python
python-libraries: $(PYTHON_LIBRARIES)
#: make wheel                  the Python package: a manylinux wheel and an sdist in build/wheel/
wheel: $(OUT)/wheel/.made
$(OUT)/wheel/.made: $(PYTHON_LIBRARIES) $(OUT)/wheel/venv/.done $(shell find python $(filter %/include,$(PYTHON_INCLUDES)) haptic_rt/core/hrt.h -type f -not -name '*.pyc')
	@$(PYTHON_WHEEL) > $(OUT)/wheel/wheel.log 2>&1 || { tail -n 20 $(OUT)/wheel/wheel.log >&2; exit 1; }
	@touch $@
	@ls -l $(OUT)/wheel/*.whl $(OUT)/wheel/*.tar.gz
#: make wheels                 wheels for Windows, arm64 Linux and macOS too, of what make cross compiles
wheels: wheel cross
	@$(PYTHON_WHEEL) $(CROSS)

# For packages of a system that has the libraries: the package without them, with links to those of LIBDIR. Needs pycparser.
PYTHONDIR ?= $(PREFIX)/lib/python3/dist-packages
install-python: $(PYTHON_LIBRARIES)
	install -d $(DESTDIR)$(PYTHONDIR)/tensormass/lib $(DESTDIR)$(PYTHONDIR)/tensormass/lcm_types
	install -m 644 python/tensormass/*.py python/tensormass/py.typed $(DESTDIR)$(PYTHONDIR)/tensormass
	install -m 644 lcm_types/*.lcm $(DESTDIR)$(PYTHONDIR)/tensormass/lcm_types
	install -m 644 $(filter %.so,$(PYTHON_LIBRARIES)) $(DESTDIR)$(PYTHONDIR)/tensormass/lib
	ln -sf $(PYTHON_SHARED:%=$(LIBDIR)/lib%.so.$(SOVERSION)) $(DESTDIR)$(PYTHONDIR)/tensormass/lib
	$(PYTHON3) python/bind.py $(DESTDIR)$(PYTHONDIR)/tensormass/_bind.py $(CC) $(PYTHON_INCLUDES) -- $(PYTHON_HEADERS)
