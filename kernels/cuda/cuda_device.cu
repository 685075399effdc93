// SPDX-License-Identifier: Apache-2.0
// Queries the CUDA device, and measures its peak bandwidth and arithmetic rate.
#include "kernels/cuda/cuda_device.h"

#include <algorithm>
#include <mutex>
#include <optional>

#include "kernels/cuda/cuda.h"
#include "kernels/cuda/device_code.h"

namespace gs {
namespace {

constexpr int kBlock = 256;
/// Number of FMA chains that a thread computes side by side, and number of links of each per loop iteration. An FMA
/// takes 4 cycles; 8 chains times the warps of a full multiprocessor hide that many times over.
constexpr int kChains = 8, kUnrolled = 16;
constexpr int kRounds = 512;

__global__ void __launch_bounds__(kBlock)
    copy_float4(const float4* __restrict__ from, float4* __restrict__ to, std::size_t n) {
    const std::size_t stride = std::size_t(gridDim.x) * kBlock;
#pragma unroll 4  // each thread has four loads under way
    for (std::size_t i = std::size_t(blockIdx.x) * kBlock + threadIdx.x; i < n; i += stride) to[i] = from[i];
}

/// Tests whether code of this build runs on the device at all.
__global__ void answer(int question, int* out) { *out = question + 1; }

/// Computes the chains. The factors are arguments, so that the compiler cannot evaluate the chains in advance.
__global__ void __launch_bounds__(kBlock) chain_fmas(float factor, float term, float* __restrict__ out) {
    float x[kChains];
    for (int c = 0; c < kChains; ++c) x[c] = float(threadIdx.x + c);
    for (int r = 0; r < kRounds; ++r) {
#pragma unroll
        for (int k = 0; k < kUnrolled; ++k)
#pragma unroll
            for (int c = 0; c < kChains; ++c) x[c] = fmaf(x[c], factor, term);
    }
    float sum = 0;
    for (int c = 0; c < kChains; ++c) sum += x[c];
    if (sum == -1.0f) *out = sum;  // never true, but keeps the compiler from removing the chains
}

class Event {
  public:
    Event() { GS_CUDA(cudaEventCreate(&event_)); }
    Event(const Event&) = delete;
    Event& operator=(const Event&) = delete;
    ~Event() { cudaEventDestroy(event_); }
    operator cudaEvent_t() const { return event_; }

  private:
    cudaEvent_t event_ = nullptr;
};

/// Device memory of a measurement. It is not a DeviceBuffer, so that it does not count in the reported peak memory.
class Memory {
  public:
    explicit Memory(std::size_t bytes) { GS_CUDA(cudaMalloc(&data_, bytes)); }
    Memory(const Memory&) = delete;
    Memory& operator=(const Memory&) = delete;
    ~Memory() { cudaFree(data_); }
    template <class T> T* as() const { return static_cast<T*>(data_); }

  private:
    void* data_ = nullptr;
};

/// Returns the shortest time of five launches after one to warm up, because a peak rate is the best that is possible.
template <class Launch> double best_seconds(const char* name, Launch&& launch) {
    const Event begin, end;
    float best = 1e30f;
    for (int k = 0; k < 6; ++k) {
        GS_CUDA(cudaEventRecord(begin));
        launch();
        GS_CUDA_LAUNCHED(name);
        GS_CUDA(cudaEventRecord(end));
        GS_CUDA(cudaEventSynchronize(end));
        float milliseconds = 0;
        GS_CUDA(cudaEventElapsedTime(&milliseconds, begin, end));
        if (k > 0) best = std::min(best, milliseconds);
    }
    return 1e-3 * double(best);
}

cudaDeviceProp current_device() {
    int device = 0;
    cudaDeviceProp properties;
    GS_CUDA(cudaGetDevice(&device));
    GS_CUDA(cudaGetDeviceProperties(&properties, device));
    return properties;
}

/// Converts CUDA's version number to text: 12080 -> "12.8".
std::string cuda_version(int number) {
    return std::to_string(number / 1000) + "." + std::to_string(number % 1000 / 10);
}

/// Returns the CUDA version that the driver supports, 0 if there is no driver.
int driver_version() {
    int version = 0;
    GS_CUDA(cudaDriverGetVersion(&version));
    return version;
}

/// The trial kernel that a process runs before it relies on its device.
class Trial {
  public:
    static Trial& of_process() {
        static Trial trial;
        return trial;
    }

    /// Returns why the kernel failed; empty if it ran, or has not been tried yet.
    std::string failure() {
        const std::lock_guard lock(mutex_);
        return failure_.value_or("");
    }

    /// Runs the kernel unless it was run before, and returns why it failed.
    std::string run() {
        const std::lock_guard lock(mutex_);
        if (!failure_) failure_ = try_now();
        return *failure_;
    }

  private:
    static std::string try_now() {
        try {
            const Memory out(sizeof(int));
            constexpr int kQuestion = 41;
            int result = 0;
            answer<<<1, 1>>>(kQuestion, out.as<int>());
            GS_CUDA_LAUNCHED("answer");
            GS_CUDA(cudaMemcpy(&result, out.as<int>(), sizeof(int), cudaMemcpyDeviceToHost));
            if (result == kQuestion + 1) return "";
            return std::string(current_device().name) + " computes wrong results: the first kernel returned " +
                   std::to_string(result) + " for " + std::to_string(kQuestion + 1);
        } catch (const DeviceError& error) {
            return "the first kernel failed on the GPU (" + std::string(error.what()) + "); built for " +
                   cuda_architectures() + " with CUDA " + cuda_version(CUDART_VERSION) + ", driver for CUDA " +
                   cuda_version(driver_version());
        }
    }

    std::mutex mutex_;
    std::optional<std::string> failure_;  ///< empty text: it ran
};

}  // namespace

std::string cuda_unavailable_reason() {
    int count = 0, driver = 0;
    // Without a driver, cudaGetDeviceCount reports an insufficient driver version.
    if (cudaDriverGetVersion(&driver) == cudaSuccess && driver == 0) return "no NVIDIA driver";
    const cudaError_t error = cudaGetDeviceCount(&count);
    if (error != cudaSuccess) return cudaGetErrorString(error);
    if (count == 0) return "no device";
    try {
        const cudaDeviceProp device = current_device();
        const std::string no_code = why_no_code(cuda_architectures(), device.name, device.major, device.minor);
        return no_code.empty() ? Trial::of_process().failure() : no_code;
    } catch (const DeviceError& unanswered) {
        return unanswered.what();
    }
}

std::string try_cuda_device() { return cuda_available() ? Trial::of_process().run() : cuda_unavailable_reason(); }

int cuda_device_count() {
    int count = 0;
    return cudaGetDeviceCount(&count) == cudaSuccess ? count : 0;
}

void use_cuda_device(int index) { GS_CUDA(cudaSetDevice(index)); }

std::string cuda_device_id() {
    if (!cuda_available()) return "";
    const cudaDeviceProp properties = current_device();
    std::string id;
    for (const char byte : properties.uuid.bytes)
        for (const int digit : {(byte >> 4) & 15, byte & 15}) id += "0123456789abcdef"[digit];
    return id;
}

bool cuda_available() { return cuda_unavailable_reason().empty(); }

std::string cuda_driver_description() {
    if (!cuda_available()) throw DeviceError("no CUDA device: " + cuda_unavailable_reason());
    const cudaDeviceProp p = current_device();
    return std::string(p.name) + " (sm_" + std::to_string(10 * p.major + p.minor) + ", " +
           std::to_string(p.totalGlobalMem >> 20) + " MiB), driver for CUDA " + cuda_version(driver_version()) +
           ", runtime " + cuda_version(CUDART_VERSION);
}

Ceilings cuda_ceilings() {
    // 2048 threads fill one multiprocessor.
    const unsigned blocks = unsigned(8 * current_device().multiProcessorCount);
    std::size_t free = 0, total = 0;
    GS_CUDA(cudaMemGetInfo(&free, &total));
    const std::size_t bytes = std::min<std::size_t>(std::size_t(1) << 30, free / 4), n = bytes / sizeof(float4);
    if (n == 0) throw DeviceError("no free device memory to measure the copy bandwidth with");
    double copy = 0;
    {
        const Memory from(n * sizeof(float4)), to(n * sizeof(float4));
        GS_CUDA(cudaMemset(from.as<void>(), 0, n * sizeof(float4)));
        copy = best_seconds("copy_float4",
                            [&] { copy_float4<<<blocks, kBlock>>>(from.as<float4>(), to.as<float4>(), n); });
    }
    const Memory out(sizeof(float));
    const double fma =
        best_seconds("chain_fmas", [&] { chain_fmas<<<blocks, kBlock>>>(0.999f, 0.001f, out.as<float>()); });
    const double operations = double(blocks) * kBlock * kRounds * kUnrolled * kChains;
    return {2.0 * double(n) * sizeof(float4) / copy, operations / fma};
}

}  // namespace gs
