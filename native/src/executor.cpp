#include "nacre/executor.hpp"

#include <algorithm>

#include "nacre/errors.hpp"

namespace nacre {

struct Executor::Job {
    Job(Index count, Invoke call, void* data) : tasks(count), invoke(call), context(data) {}

    Index tasks;
    Invoke invoke;
    void* context;
    std::atomic<Index> next{0}, done{0};
    std::atomic<bool> stop{false};
    std::mutex mutex;
    std::exception_ptr error;

    void fail(std::exception_ptr e) {
        std::lock_guard lock(mutex);
        if (!error) error = std::move(e);
        stop = true;
    }
};

namespace {

constexpr auto kPollInterval = std::chrono::milliseconds(50);
constexpr auto kSpin = std::chrono::microseconds(50);

inline void relax() {
#if defined(__x86_64__) || defined(__i386__)
    __builtin_ia32_pause();
#else
    std::this_thread::yield();
#endif
}

}  // namespace

Executor::Executor(int threads, Progress progress) : progress_(std::move(progress)) {
    require(threads >= 0, "threads: expected 0 (all) or more, got ", threads);
    if (threads == 0) threads = static_cast<int>(std::thread::hardware_concurrency());
    threads = std::clamp(threads, 1, 256);
    last_poll_ = std::chrono::steady_clock::now() - kPollInterval;
    workers_.reserve(static_cast<std::size_t>(threads - 1));
    for (int worker = 1; worker < threads; ++worker) {
        workers_.emplace_back([this, worker] { work(worker); });
    }
}

Executor::~Executor() {
    {
        std::lock_guard lock(mutex_);
        quit_ = true;
        ++generation_;
    }
    wake_.notify_all();
    for (std::thread& thread : workers_) thread.join();
}

void Executor::stage(double begin, double end, std::string message) {
    begin_ = begin;
    end_ = end;
    fraction_ = std::max(fraction_, begin);
    message_ = std::move(message);
    poll(true);
}

void Executor::poll(bool force) {
    if (!progress_) return;
    const auto now = std::chrono::steady_clock::now();
    if (!force && now - last_poll_ < kPollInterval) return;
    last_poll_ = now;
    if (!progress_(fraction_, message_)) throw Cancelled();
}

void Executor::take_tasks(Job& job, int worker) {
    while (!job.stop.load(std::memory_order_relaxed)) {
        const Index task = job.next.fetch_add(1, std::memory_order_relaxed);
        if (task >= job.tasks) return;
        try {
            job.invoke(job.context, task, worker);
        } catch (...) {
            job.fail(std::current_exception());
        }
        job.done.fetch_add(1, std::memory_order_relaxed);
    }
}

void Executor::work(int worker) {
    std::uint64_t seen = 0;
    for (;;) {
        // Loops follow each other closely inside a fit: look a little before sleeping.
        const auto until = std::chrono::steady_clock::now() + kSpin;
        while (generation_.load(std::memory_order_relaxed) == seen &&
               std::chrono::steady_clock::now() < until) {
            relax();
        }
        Job* job = nullptr;
        {
            std::unique_lock lock(mutex_);
            wake_.wait(lock, [&] { return generation_.load() != seen; });
            seen = generation_.load();
            if (quit_) return;
            job = job_;
            if (!job) continue;
            ++active_;
        }
        take_tasks(*job, worker);
        {
            std::lock_guard lock(mutex_);
            --active_;
        }
        idle_.notify_one();
    }
}

void Executor::run(Index tasks, Invoke invoke, void* context, bool advance) {
    if (tasks <= 0) return;
    Job job(tasks, invoke, context);
    const bool shared = !workers_.empty() && tasks > 1;
    if (shared) {
        {
            std::lock_guard lock(mutex_);
            job_ = &job;
            ++generation_;
        }
        wake_.notify_all();
    }
    try {
        while (!job.stop.load(std::memory_order_relaxed)) {
            const Index task = job.next.fetch_add(1, std::memory_order_relaxed);
            if (task >= tasks) break;
            job.invoke(job.context, task, 0);
            const Index done = 1 + job.done.fetch_add(1, std::memory_order_relaxed);
            if (advance) {
                const double share = static_cast<double>(done) / static_cast<double>(tasks);
                fraction_ = std::max(fraction_, begin_ + (end_ - begin_) * share);
            }
            poll();
        }
    } catch (...) {
        job.fail(std::current_exception());
    }
    if (shared) {
        std::unique_lock lock(mutex_);
        job_ = nullptr;
        idle_.wait(lock, [&] { return active_ == 0; });
    }
    if (job.error) std::rethrow_exception(job.error);
}

}  // namespace nacre
