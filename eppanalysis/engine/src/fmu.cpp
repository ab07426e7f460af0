// The run as a Co-Simulation unit of FMI 2 and 3: a library without Python, which reads the tables of a loop from a file.
//
// The file holds a token, then the tables in the order of `fields.hpp`, as `eppanalysis/fmu/export.py` writes them:
// lengths of each array, whether its numbers follow, and these. A communication step ends at its time exactly, and the
// next one goes on from there. Inputs are held in between; one that has changed jumps at the begin of the step, as at a
// breakpoint.

#include <cstring>
#include <exception>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>
#include <stdexcept>
#include <string>

#include "engine/run.hpp"
#include "fields.hpp"

#ifdef _WIN32
#define EXPORT extern "C" __declspec(dllexport)
#else
#define EXPORT extern "C" __attribute__((visibility("default")))
#endif

using namespace epp;

namespace {

/// The bytes of a file, from front to back, and the memory of the arrays that are read from it.
class File {
  public:
    explicit File(const std::string& path) {
        std::ifstream file(std::filesystem::u8path(path), std::ios::binary);
        bytes.assign(std::istreambuf_iterator<char>(file), {});
        if (bytes.empty()) throw std::runtime_error(path + " is not there; expected the tables of the loop");
    }
    std::string text(size_t length) { return std::string(taken(length), length); }
    void read(Progress& now) { std::memcpy(&now, taken(sizeof now), sizeof now); }
    template <class T, int N> void read(View<T, N>& array) {
        for (i64& length : array.lengths) length = number();
        const size_t size = static_cast<size_t>(array.size()) * sizeof(T);
        const bool given = number() != 0;
        array.data = static_cast<T*>(room(size));
        if (given) std::memcpy(array.data, taken(size), size);
    }
    template <class T> void read(T& table) {
        std::apply([&](auto&... field) { (read(field), ...); }, Fields<T>::of(table));
    }
    template <class... T> void read(T&... tables) { (read(tables), ...); }

  private:
    struct Free {
        void operator()(void* memory) const { std::free(memory); }
    };
    std::vector<char> bytes;
    size_t at = 0;
    std::vector<std::unique_ptr<void, Free>> blocks;

    const char* taken(size_t length) {
        if (bytes.size() - at < length) throw std::runtime_error("the tables of the loop end too early");
        at += length;
        return bytes.data() + at - length;
    }
    i64 number() {
        i64 out;
        std::memcpy(&out, taken(sizeof out), sizeof out);
        return out;
    }
    /// Zeros that begin where eight numbers do.
    void* room(size_t size) {
        blocks.emplace_back(std::calloc(size + 64, 1));
        if (!blocks.back()) throw std::bad_alloc();
        return reinterpret_cast<void*>((reinterpret_cast<std::uintptr_t>(blocks.back().get()) + 63) / 64 * 64);
    }
};

/// A loop on its run.
class Loop {
  public:
    /// Values of the inputs, from the next step on.
    std::vector<double> inputs;

    Loop(const std::string& folder, const std::string& token) : file(folder + "/loop.bin") {
        if (file.text(token.size()) != token) throw std::runtime_error("its token is not that of the model description");
        file.read(model, compiled, work, workspace, samples, buffer, now, x0, H0, modes0, state, slope, without_memory);
        none = samples;
        none.phases.lengths[0] = 0;
        inputs.assign(static_cast<size_t>(state.size()), 0.0);
        held = inputs;
        breakpoints([](auto& column, auto& view) { column.assign(view.begin(), view.end()); });
    }

    double time() const { return reached; }
    View<double, 1> outputs() const { return samples.out.row(0).slice(0, model.Yx.shape(0)); }

    /// From the start on, behind what happens there at once.
    void begin() {
        jump();
        workspace.x.slice(0, x0.size()).copy(x0);
        workspace.modes.copy(modes0);
        workspace.H.copy(H0);
        bool late = false;
        for (i64 kind : model.smooth_kind) late = late || kind == DELAY_LINE;
        now.past_known = late && model.breakpoint_time.size() > 0 && model.breakpoint_time(0) <= 0.0;
        if (now.past_known)
            step_at_start(model, compiled, work, workspace, none, buffer, now, x0, modes0, H0, without_memory);
        go(0.0);
        // A period that has closed is not repeated without being computed: inputs may change at any time.
        now.watched = false;
        settle();
    }

    /// On to a time, from where the run is.
    void advance(double t) {
        if (!(t >= reached)) throw std::runtime_error("a step leads back in time");
        jump();
        proceed(t);
        // As in a run with samples: one where an input jumps is behind all that the jump brings about.
        const i64 passed = now.i_breakpoint;
        if (passed > 0 && model.breakpoint_time(passed - 1) == now.t) settle();
        reached = t;
    }

  private:
    File file;
    Model model;
    Combinations compiled;
    Work work;
    Workspace workspace;
    Samples samples, none;
    EventBuffer buffer;
    Progress now;
    Vector x0, H0;
    Indices modes0, state, slope;
    Flags without_memory;
    double reached = 0.0;
    std::vector<double> held, times, values, slopes;
    std::vector<i64> states, memories;

    /// Each column of the table of breakpoints, and the engine's view of it.
    template <class F> void breakpoints(F&& each) {
        each(times, model.breakpoint_time);
        each(states, model.breakpoint_state);
        each(values, model.breakpoint_value);
        each(memories, model.breakpoint_memory);
        each(slopes, model.breakpoint_slope);
    }

    /// Inputs that have changed jump now, behind all breakpoints that have passed.
    void jump() {
        if (inputs == held) return;
        breakpoints([&](auto& column, auto&) { column.erase(column.begin(), column.begin() + now.i_breakpoint); });
        now.i_breakpoint = 0;
        const auto behind = std::upper_bound(times.begin(), times.end(), now.t) - times.begin();
        for (size_t i = 0; i < inputs.size(); ++i) {
            if (inputs[i] == held[i]) continue;
            times.insert(times.begin() + behind, now.t);
            states.insert(states.begin() + behind, state(static_cast<i64>(i)));
            values.insert(values.begin() + behind, inputs[i]);
            memories.insert(memories.begin() + behind, slope(static_cast<i64>(i)));
            slopes.insert(slopes.begin() + behind, 0.0);
        }
        held = inputs;
        breakpoints([](auto& column, auto& view) { view = {column.data(), {static_cast<i64>(column.size())}}; });
    }

    /// Go on by an instant, in which what happens at once does.
    void settle() { proceed(now.t + greatest_of(INSTANT * now.base_step, 16.0 * EPS * now.t)); }

    void proceed(double t) {
        now.entered = now.armed = false;
        now.paused = true;
        go(t);
    }

    /// Run to a time, and signals there.
    void go(double t) {
        now.t_end = now.until = t;
        now.spent = 0.0;
        i64 code = PAUSED;
        while (code == PAUSED) code = run(model, compiled, work, workspace, none, buffer, now);
        if (code == SINGULAR) throw std::runtime_error("the loop has no unique solution in one combination of modes");
        if (code == HISTORY) throw std::runtime_error("a dead time spans more switches than its history holds");
        if (code == DIVERGED) throw std::runtime_error("the state grows beyond 1e100");
        if (code != DONE) throw std::runtime_error("more switches or steps than one communication step may have");
        now.i_sample = 0;
        now.n_samples = 1;
        samples.times(0) = now.t;
        _finish(model, compiled, workspace, samples, now);
        now.n_samples = 0;
    }
};

/// One instance of a unit, and whom it tells what went wrong.
struct Unit {
    std::string folder, token;
    std::function<void(int, const char*)> log;
    std::unique_ptr<Loop> loop;
    double start = 0.0;

    void reset() { loop = std::make_unique<Loop>(folder, token); }
};

constexpr int OK = 0, FAILED = 3;  // status of a call in both versions

/// What a call does, its failure as a status.
template <class F> int guarded(void* instance, F&& call) noexcept {
    Unit& unit = *static_cast<Unit*>(instance);
    try {
        call(unit);
        return OK;
    } catch (const std::exception& failure) {
        if (unit.log) unit.log(FAILED, failure.what());
        return FAILED;
    }
}

void* instantiate(const std::string& folder, const char* token, std::function<void(int, const char*)> log) noexcept {
    auto unit = std::make_unique<Unit>();
    const auto made = guarded(unit.get(), [&](Unit& one) {
        one.folder = folder;
        one.token = token;
        one.log = std::move(log);
        one.reset();
    });
    return made == OK ? unit.release() : nullptr;
}

/// Values of variables: inputs first, then outputs, then the time.
int get(void* instance, const unsigned int* references, size_t count, double* values) {
    return guarded(instance, [&](Unit& unit) {
        const auto& inputs = unit.loop->inputs;
        const auto outputs = unit.loop->outputs();
        for (size_t i = 0; i < count; ++i) {
            const size_t k = references[i], n = inputs.size(), m = static_cast<size_t>(outputs.size());
            if (k > n + m) throw std::runtime_error("no variable has reference " + std::to_string(k));
            values[i] = k < n ? inputs[k] : k < n + m ? outputs(static_cast<i64>(k - n)) : unit.start + unit.loop->time();
        }
    });
}
int set(void* instance, const unsigned int* references, size_t count, const double* values) {
    return guarded(instance, [&](Unit& unit) {
        auto& inputs = unit.loop->inputs;
        for (size_t i = 0; i < count; ++i) {
            if (references[i] >= inputs.size() || !std::isfinite(values[i]))
                throw std::runtime_error("variable " + std::to_string(references[i]) + " takes no " + std::to_string(values[i]));
            inputs[references[i]] = values[i];
        }
    });
}
int step(void* instance, double from, double length) {
    return guarded(instance, [&](Unit& unit) { unit.loop->advance(from + length - unit.start); });
}
int start_at(void* instance, double time) { return guarded(instance, [&](Unit& unit) { unit.start = time; }); }
int begin(void* instance) { return guarded(instance, [](Unit& unit) { unit.loop->begin(); }); }
int reset(void* instance) { return guarded(instance, [](Unit& unit) { unit.reset(); }); }

/// The folder that a URI names.
std::string folder_of(const std::string& uri) {
    std::string path;
    const size_t first = uri.rfind("file:", 0) != 0 ? 0 : uri.rfind("file://", 0) == 0 ? uri.find('/', 7) : 5;
    for (size_t i = first; i < uri.size(); ++i) {
        if (uri[i] == '%' && i + 2 < uri.size()) {
            path += static_cast<char>(std::stoi(uri.substr(i + 1, 2), nullptr, 16));
            i += 2;
        } else {
            path += uri[i];
        }
    }
    return path.size() > 2 && path[0] == '/' && path[2] == ':' ? path.substr(1) : path;  // /C:/...
}

}  // namespace

// The functions of the standard, by own declarations. What the model description says that the unit cannot do fails
// whatever its further arguments are, which it does not read: the caller takes them off the stack.

#define DOES_NOTHING(name) EXPORT int name(void*) { return OK; }
#define CANNOT(name) EXPORT int name(void*) { return FAILED; }
#define CANNOT_PASS(type) CANNOT(fmi3Get##type) CANNOT(fmi3Set##type)

using References = const unsigned int*;

struct Callbacks2 {
    void (*logger)(void*, const char*, int, const char*, const char*, ...);
    void* (*allocate)(size_t, size_t);
    void (*free)(void*);
    void (*step_finished)(void*, int);
    void* environment;
};

EXPORT const char* fmi2GetTypesPlatform() { return "default"; }
EXPORT const char* fmi2GetVersion() { return "2.0"; }
EXPORT void* fmi2Instantiate(const char* name, int kind, const char* token, const char* resources, const Callbacks2* callbacks,
    int, int) {
    if (kind != 1) return nullptr;  // Model Exchange
    auto log = [=, name = std::string(name)](int status, const char* what) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name.c_str(), status, "logStatusError", "%s", what);
    };
    return instantiate(folder_of(resources), token, log);
}
EXPORT void fmi2FreeInstance(void* instance) { delete static_cast<Unit*>(instance); }
EXPORT int fmi2SetupExperiment(void* instance, int, double, double start, int, double) { return start_at(instance, start); }
EXPORT int fmi2ExitInitializationMode(void* instance) { return begin(instance); }
EXPORT int fmi2Reset(void* instance) { return reset(instance); }
EXPORT int fmi2GetReal(void* instance, References vr, size_t n, double* to) { return get(instance, vr, n, to); }
EXPORT int fmi2SetReal(void* instance, References vr, size_t n, const double* to) { return set(instance, vr, n, to); }
EXPORT int fmi2DoStep(void* instance, double from, double length, int) { return step(instance, from, length); }
DOES_NOTHING(fmi2SetDebugLogging) DOES_NOTHING(fmi2EnterInitializationMode) DOES_NOTHING(fmi2Terminate)
CANNOT(fmi2GetInteger) CANNOT(fmi2GetBoolean) CANNOT(fmi2GetString) CANNOT(fmi2SetInteger) CANNOT(fmi2SetBoolean)
CANNOT(fmi2SetString) CANNOT(fmi2GetFMUstate) CANNOT(fmi2SetFMUstate) CANNOT(fmi2FreeFMUstate)
CANNOT(fmi2SerializedFMUstateSize) CANNOT(fmi2SerializeFMUstate) CANNOT(fmi2DeSerializeFMUstate)
CANNOT(fmi2GetDirectionalDerivative) CANNOT(fmi2SetRealInputDerivatives) CANNOT(fmi2GetRealOutputDerivatives)
CANNOT(fmi2CancelStep) CANNOT(fmi2GetStatus) CANNOT(fmi2GetRealStatus) CANNOT(fmi2GetIntegerStatus)
CANNOT(fmi2GetBooleanStatus) CANNOT(fmi2GetStringStatus)

EXPORT const char* fmi3GetVersion() { return "3.0"; }
EXPORT void* fmi3InstantiateCoSimulation(const char*, const char* token, const char* resources, bool, bool, bool, bool,
    References, size_t, void* environment, void (*logger)(void*, int, const char*, const char*), void*) {
    auto log = [=](int status, const char* what) {
        if (logger) logger(environment, status, "logStatusError", what);
    };
    return instantiate(resources, token, log);
}
EXPORT void* fmi3InstantiateModelExchange(const char*) { return nullptr; }
EXPORT void* fmi3InstantiateScheduledExecution(const char*) { return nullptr; }
EXPORT void fmi3FreeInstance(void* instance) { delete static_cast<Unit*>(instance); }
EXPORT int fmi3EnterInitializationMode(void* instance, bool, double, double start, bool, double) {
    return start_at(instance, start);
}
EXPORT int fmi3ExitInitializationMode(void* instance) { return begin(instance); }
EXPORT int fmi3Reset(void* instance) { return reset(instance); }
EXPORT int fmi3GetFloat64(void* instance, References vr, size_t n, double* to, size_t) { return get(instance, vr, n, to); }
EXPORT int fmi3SetFloat64(void* instance, References vr, size_t n, const double* to, size_t) {
    return set(instance, vr, n, to);
}
EXPORT int fmi3DoStep(void* instance, double from, double length, bool, bool* events, bool* ends, bool* early, double* reached) {
    *events = *ends = *early = false;
    const int status = step(instance, from, length);
    *reached = status == OK ? from + length : from;
    return status;
}
DOES_NOTHING(fmi3SetDebugLogging) DOES_NOTHING(fmi3Terminate)
CANNOT_PASS(Float32) CANNOT_PASS(Int8) CANNOT_PASS(UInt8) CANNOT_PASS(Int16) CANNOT_PASS(UInt16) CANNOT_PASS(Int32)
CANNOT_PASS(UInt32) CANNOT_PASS(Int64) CANNOT_PASS(UInt64) CANNOT_PASS(Boolean) CANNOT_PASS(String) CANNOT_PASS(Binary)
CANNOT_PASS(Clock) CANNOT_PASS(FMUState) CANNOT_PASS(IntervalDecimal) CANNOT_PASS(IntervalFraction)
CANNOT_PASS(ShiftDecimal) CANNOT_PASS(ShiftFraction) CANNOT_PASS(ContinuousStates)
CANNOT(fmi3FreeFMUState) CANNOT(fmi3SerializedFMUStateSize) CANNOT(fmi3SerializeFMUState)
CANNOT(fmi3DeserializeFMUState) CANNOT(fmi3GetNumberOfVariableDependencies) CANNOT(fmi3GetVariableDependencies)
CANNOT(fmi3GetDirectionalDerivative) CANNOT(fmi3GetAdjointDerivative) CANNOT(fmi3GetOutputDerivatives)
CANNOT(fmi3EnterConfigurationMode) CANNOT(fmi3ExitConfigurationMode) CANNOT(fmi3EnterEventMode)
CANNOT(fmi3EnterStepMode) CANNOT(fmi3EnterContinuousTimeMode) CANNOT(fmi3EvaluateDiscreteStates)
CANNOT(fmi3UpdateDiscreteStates) CANNOT(fmi3CompletedIntegratorStep) CANNOT(fmi3SetTime)
CANNOT(fmi3GetContinuousStateDerivatives) CANNOT(fmi3GetEventIndicators) CANNOT(fmi3GetNominalsOfContinuousStates)
CANNOT(fmi3GetNumberOfEventIndicators) CANNOT(fmi3GetNumberOfContinuousStates) CANNOT(fmi3ActivateModelPartition)
