# The Python package (docs/python.md). Nothing else waits for it: `make wheel` and its tests alone build what is here.
# libtensormass_controller.so: the controller's core, its functions to be seen. The other libraries are copies.
PYTHON_LIB := $(OUT)/python-lib
PYTHON_LIBRARIES := $(patsubst %,$(PYTHON_LIB)/lib%.so.$(SOVERSION),tensormass tensormass_io tensormass_solve tensormass_scene) \
	$(PYTHON_LIB)/libtensormass_controller.so
PYTHON_CORE_SRC := $(filter haptic_rt/core/%,$(HRT_CORE_SRC))
PYTHON_CORE_OBJ := $(patsubst %.c,$(OUT)/obj/python/%.o,$(PYTHON_CORE_SRC))
$(PYTHON_LIB)/%.so.$(SOVERSION): $(OUT)/lib/%.so.$(VERSION)
	@mkdir -p $(@D)
	$(call say,COPY)
	$(Q)cp $< $@
$(OUT)/obj/python/%.o: %.c Makefile
	@mkdir -p $(@D)
	$(call say,CC)
	$(Q)$(CC) $(BASE_CFLAGS) -fvisibility=default $(INCLUDES) -c $< -o $@
$(PYTHON_LIB)/libtensormass_controller.so: $(PYTHON_CORE_OBJ)
	@mkdir -p $(@D)
	$(call say,LINK)
	$(Q)$(CC) $(SAN) -shared -Wl,-soname,$(@F) -o $@ $^ -lm
.PHONY: python-libraries
python-libraries: $(PYTHON_LIBRARIES)
# Headers that the package calls, by the library that has them.
PYTHON_HEADERS := tensormass=libtensormass/include/tensormass.h tensormass_io=libtensormass/io/include/tensormass_io.h \
	tensormass_solve=libtensormass/include/tensormass_solve.h \
	tensormass_controller=haptic_rt/core/hrt.h tensormass_scene=libtensormass/scene/include/tensormass_scene.h
PYTHON_VENV := $(OUT)/wheel/venv
$(PYTHON_VENV)/.done: python/requirements.txt
	@mkdir -p $(@D)
	@flock $(@D).lock sh -c '/usr/bin/python3 -m venv $(@D) && $(@D)/bin/pip install -q --disable-pip-version-check -r $<' || { echo "make wheel: pip could not install what python/requirements.txt names; check the network or the package index" >&2; exit 2; }
	@touch $@
#: make wheel                  the Python package: a manylinux wheel and an sdist in build/wheel/
PYTHON_PARTS := $(shell find python libtensormass/include libtensormass/io/include libtensormass/scene/include haptic_rt/core/hrt.h -type f -not -name '*.pyc')
.PHONY: wheel
wheel: $(OUT)/wheel/.made
$(OUT)/wheel/.made: $(PYTHON_LIBRARIES) $(PYTHON_VENV)/.done $(PYTHON_PARTS)
	@python/wheel.sh $(OUT) $(abspath $(PYTHON_VENV))/bin/python > $(OUT)/wheel/wheel.log 2>&1 || { tail -n 20 $(OUT)/wheel/wheel.log >&2; exit 1; }
	@touch $@
	@ls -l $(OUT)/wheel/*.whl $(OUT)/wheel/*.tar.gz
#: make wheels                 wheels for Windows, arm64 Linux and macOS too, of what make cross compiles
.PHONY: wheels
wheels: wheel cross
	@python/wheel.sh $(OUT) $(abspath $(PYTHON_VENV))/bin/python $(CROSS)

# For packages of a system that has the libraries itself: the package without them, links to those of LIBDIR. Needs pycparser.
PYTHONDIR ?= $(PREFIX)/lib/python3/dist-packages
.PHONY: install-python
install-python: $(PYTHON_LIBRARIES)
	install -d $(DESTDIR)$(PYTHONDIR)/tensormass/lib $(DESTDIR)$(PYTHONDIR)/tensormass/lcm_types
	install -m 644 python/tensormass/*.py python/tensormass/py.typed $(DESTDIR)$(PYTHONDIR)/tensormass
	install -m 644 lcm_types/*.lcm $(DESTDIR)$(PYTHONDIR)/tensormass/lcm_types
	install -m 644 $(filter %.so,$(PYTHON_LIBRARIES)) $(DESTDIR)$(PYTHONDIR)/tensormass/lib
	ln -sf $(patsubst %,$(LIBDIR)/lib%.so.$(SOVERSION),tensormass tensormass_io tensormass_solve tensormass_scene) $(DESTDIR)$(PYTHONDIR)/tensormass/lib
	$(PYTHON3) python/bind.py $(DESTDIR)$(PYTHONDIR)/tensormass/_bind.py $(CC) libtensormass/include libtensormass/io/include libtensormass/scene/include haptic_rt/core -- $(PYTHON_HEADERS)
