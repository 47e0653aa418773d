# Everything is set up in .venv from PyPI, the real ROS 2 Jazzy included; a ROS install is
# neither needed nor touched. PYTHON=python3.12 picks another interpreter.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
VERSION := $(shell $(PYTHON) -c 'import sys; print("%d.%d" % sys.version_info[:2])')
ifeq ($(VERSION),)
$(error PYTHON=$(PYTHON) does not run)
endif
PIP := $(BIN)/python -m pip --disable-pip-version-check -qq install --constraint constraints.txt
SOURCES := $(shell find kinopt_ros config launch resource -type f -not -name '*.pyc') \
	setup.py setup.cfg package.xml
INTERFACE_SOURCES := $(shell find kinopt_interfaces -type f)
CXX_FOUND := $(shell command -v $(CXX))

# What a sourced ROS install or the wheels of another .venv leave in the environment.
unexport PYTHONPATH LD_LIBRARY_PATH _ROS_WHEELS_BOOTSTRAP_COMPLETE
unexport AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION ROS_LOCALHOST_ONLY
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.PHONY: help setup demo test bench lint interfaces colcon clean

help:
	@echo 'make demo        watch the monitor follow a simulated arm for 15 s'
	@echo 'make test        run all tests'
	@echo 'make bench       measure speed, latency and memory (some twenty minutes)'
	@echo 'make setup       prepare .venv with the package and its executables'
	@echo 'make interfaces  build kinopt_interfaces into .venv (needs a C++ compiler)'
	@echo 'make colcon      build with colcon and check what it installs'
	@echo 'make lint        ruff'
	@echo 'make clean       remove .venv and everything built'

setup: $(VENV)/.package

demo: $(VENV)/.package
	@$(BIN)/demo

test: $(VENV)/.package $(VENV)/.test $(if $(CXX_FOUND),$(VENV)/.interfaces)
	@$(BIN)/python -m pytest $(PYTEST_ARGS)

# The libraries to compare with are left out, with the reason, where they cannot be had.
bench: $(VENV)/.test
	-@$(PIP) --no-build-isolation '.[bench]'
	@$(BIN)/python benchmark/run.py $(BENCH_ARGS)

lint: $(VENV)/.test
	@$(BIN)/ruff check

interfaces: $(VENV)/.interfaces

# Another interpreter than last time starts from nothing.
$(VENV)/.python-$(VERSION): constraints.txt setup.py
	@echo 'setting up $(VENV) for Python $(VERSION) (about a minute, once)'
	@rm -rf $(VENV)
	@$(PYTHON) -m venv $(VENV)
	@$(PIP) pip setuptools wheel
	@touch $@

$(VENV)/.package: $(VENV)/.python-$(VERSION) $(SOURCES)
	@rm -rf build/lib build/bdist.*
	@$(PIP) --no-build-isolation '.[wheels,plot]'
	@touch $@

$(VENV)/.test: $(VENV)/.python-$(VERSION) | $(VENV)/.package
	@$(PIP) --no-build-isolation '.[test]'
	@touch $@

$(VENV)/.interfaces: $(VENV)/.python-$(VERSION) $(INTERFACE_SOURCES) | $(VENV)/.package
	@echo 'building kinopt_interfaces'
	@$(PIP) --no-build-isolation '.[interfaces]'
	@CMAKE_PREFIX_PATH=$(CURDIR)/$(VENV) AMENT_PREFIX_PATH=$(CURDIR)/$(VENV) \
		$(PIP) --no-build-isolation ./kinopt_interfaces
	@touch $@

# Both packages, as `colcon build` makes them for `ros2 run` and `ros2 launch`.
colcon: $(VENV)/.interfaces
	@$(PIP) --no-build-isolation '.[colcon]'
	@rm -rf output/colcon
	@PATH=$(CURDIR)/$(BIN):$$PATH AMENT_PREFIX_PATH=$(CURDIR)/$(VENV) \
		$(BIN)/colcon --log-base output/colcon/log build \
		--build-base output/colcon/build --install-base output/colcon/install
	@$(BIN)/python .ci/check_install.py output/colcon/install
	@mkdir -p output/workspace/src && ln -sfn $(CURDIR) output/workspace/src/kinopt_ros
	@cd output/workspace && test "$$(AMENT_PREFIX_PATH= $(CURDIR)/$(BIN)/colcon list \
		--names-only --base-paths src src/kinopt_ros/kinopt_interfaces | sort | xargs)" \
		= 'kinopt_interfaces kinopt_ros' && echo 'colcon: both are found in a larger workspace'

clean:
	@rm -rf $(VENV) build install log output *.egg-info
