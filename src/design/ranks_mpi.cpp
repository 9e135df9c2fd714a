// Copyright (c) 2026 the Polypod authors. SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <mpi.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <deque>
#include <list>
#include <map>
#include <mutex>
#include <set>
#include <thread>

#include "polypod/design/ranks.hpp"

namespace polypod::design {
namespace {

using Clock = std::chrono::steady_clock;
constexpr std::chrono::microseconds kPause(200);
constexpr std::chrono::seconds kBeat(1), kSilence(20);
constexpr const char* kCancelled = "WS110";

enum Tag { kStudy = 1, kTask, kCancel, kStop, kResult, kAlive };

/// A message: numbers and texts one after the other.
class Message {
 public:
  Message() = default;
  explicit Message(std::vector<char> bytes) : bytes_(std::move(bytes)) {}
  [[nodiscard]] const std::vector<char>& bytes() const { return bytes_; }

  void put(double x) { raw(&x, sizeof x); }
  void put(std::int64_t x) { raw(&x, sizeof x); }
  void put(const std::string& x) {
    put(static_cast<std::int64_t>(x.size()));
    raw(x.data(), x.size());
  }
  void put(const std::vector<double>& x) {
    put(static_cast<std::int64_t>(x.size()));
    for (const double v : x) put(v);
  }
  void put(const Value& v) {
    for (const double x : {v.value, v.lower, v.upper}) put(x);
  }
  double number() {
    double x = 0;
    take(&x, sizeof x);
    return x;
  }
  std::int64_t integer() {
    std::int64_t x = 0;
    take(&x, sizeof x);
    return x;
  }
  std::string text() {
    std::string x(static_cast<std::size_t>(integer()), '\0');
    take(x.data(), x.size());
    return x;
  }
  std::vector<double> numbers() {
    std::vector<double> x(static_cast<std::size_t>(integer()));
    for (double& v : x) v = number();
    return x;
  }
  Value value() {
    Value v;
    for (double* x : {&v.value, &v.lower, &v.upper}) *x = number();
    return v;
  }

 private:
  void raw(const void* from, std::size_t n) {
    const auto* begin = static_cast<const char*>(from);
    bytes_.insert(bytes_.end(), begin, begin + n);
  }
  void take(void* to, std::size_t n) {
    std::memcpy(to, bytes_.data() + at_, n);
    at_ += n;
  }
  std::vector<char> bytes_;
  std::size_t at_ = 0;
};

void send(int to, int tag, const Message& m = {}) {
  MPI_Send(m.bytes().data(), static_cast<int>(m.bytes().size()), MPI_CHAR, to, tag, MPI_COMM_WORLD);
}

/// What rank 0 sends, without waiting until it has arrived: a rank that is gone takes nothing any more, and a message
/// that does not fit into the buffers of MPI would wait for it for ever.
class Outbox {
 public:
  void send(int to, int tag, const Message& m = {}) {
    erase_sent();
    Letter& letter = letters_.emplace_back();
    letter.bytes = m.bytes();
    MPI_Isend(letter.bytes.data(), static_cast<int>(letter.bytes.size()), MPI_CHAR, to, tag, MPI_COMM_WORLD,
              &letter.request);
  }
  void erase_sent() {
    std::erase_if(letters_, [](Letter& letter) {
      int sent = 0;
      MPI_Test(&letter.request, &sent, MPI_STATUS_IGNORE);
      return sent != 0;
    });
  }
  [[nodiscard]] bool empty() const { return letters_.empty(); }

 private:
  struct Letter {
    std::vector<char> bytes;
    MPI_Request request = MPI_REQUEST_NULL;
  };
  std::list<Letter> letters_;  // MPI keeps the addresses until they are sent
};

struct Received {
  int from = 0, tag = 0;
  Message message;
};

/// What has arrived, if anything.
std::optional<Received> receive() {
  MPI_Status status;
  int there = 0, size = 0;
  MPI_Iprobe(MPI_ANY_SOURCE, MPI_ANY_TAG, MPI_COMM_WORLD, &there, &status);
  if (there == 0) return {};
  MPI_Get_count(&status, MPI_CHAR, &size);
  std::vector<char> bytes(static_cast<std::size_t>(size));
  MPI_Recv(bytes.data(), size, MPI_CHAR, status.MPI_SOURCE, status.MPI_TAG, MPI_COMM_WORLD, MPI_STATUS_IGNORE);
  return Received{status.MPI_SOURCE, status.MPI_TAG, Message(std::move(bytes))};
}

/// A task; `work` tells late answers to what was asked before.
struct Order {
  std::int64_t work = 0;
  Task task;
};

Message message_of(const Order& order) {
  const Task& t = order.task;
  Message m;
  m.put(order.work);
  m.put(static_cast<std::int64_t>(t.index));
  m.put(static_cast<std::int64_t>(t.row.phase == Phase::start));
  m.put(static_cast<std::int64_t>(t.resolution));
  m.put(t.row.varied);
  m.put(t.incumbents.objective);
  m.put(static_cast<std::int64_t>(t.incumbents.front.size()));
  for (const auto& point : t.incumbents.front) m.put(point);
  return m;
}

Order order_of(Message& m) {
  Order order;
  Task& t = order.task;
  order.work = m.integer();
  t.index = static_cast<std::size_t>(m.integer());
  t.row.phase = m.integer() != 0 ? Phase::start : Phase::search;
  t.resolution = static_cast<int>(m.integer());
  t.row.varied = m.numbers();
  t.incumbents.objective = m.number();
  t.incumbents.front.resize(static_cast<std::size_t>(m.integer()));
  for (auto& point : t.incumbents.front) point = m.numbers();
  return order;
}

struct Answer {
  std::int64_t work = 0;
  std::size_t index = 0;
  Result<Evaluation> evaluation;
};

Message message_of(const Answer& a) {
  Message m;
  m.put(a.work);
  m.put(static_cast<std::int64_t>(a.index));
  m.put(static_cast<std::int64_t>(a.evaluation.has_value()));
  if (!a.evaluation) {
    m.put(a.evaluation.error().id);
    m.put(a.evaluation.error().message);
    return m;
  }
  const Evaluation& e = *a.evaluation;
  m.put(static_cast<std::int64_t>(e.state));
  m.put(e.reason);
  m.put(static_cast<std::int64_t>(e.figures.size()));
  for (const Value& v : e.figures) m.put(v);
  m.put(e.objective);
  m.put(e.violation);
  m.put(e.seconds);
  return m;
}

Answer answer_of(Message& m) {
  Answer a;
  a.work = m.integer();
  a.index = static_cast<std::size_t>(m.integer());
  if (m.integer() == 0) {
    const std::string id = m.text();
    a.evaluation = fail(id, m.text());
    return a;
  }
  Evaluation e;
  e.state = static_cast<State>(m.integer());
  e.reason = m.text();
  e.figures.resize(static_cast<std::size_t>(m.integer()));
  for (Value& v : e.figures) v = m.value();
  e.objective = m.value();
  e.violation = m.number();
  e.seconds = m.number();
  a.evaluation = std::move(e);
  return a;
}

/// Threads that compute tasks while the thread that speaks MPI goes on.
class Pool {
 public:
  Pool(const Study& study, int threads, std::function<bool()> cancelled)
      : study_(study), cancelled_(std::move(cancelled)) {
    for (int i = 0; i < std::max(1, threads); ++i) threads_.emplace_back([this] { help(); });
  }
  Pool(const Pool&) = delete;
  Pool& operator=(const Pool&) = delete;
  ~Pool() {
    {
      const std::lock_guard guard(mutex_);
      over_ = stop_ = true;
      there_.notify_all();
    }
    for (std::thread& t : threads_) t.join();
  }

  [[nodiscard]] std::size_t size() const { return threads_.size(); }
  /// Tasks that wait or are being computed.
  [[nodiscard]] std::size_t busy() const { return busy_; }
  void add(Order order) {
    ++busy_;
    const std::lock_guard guard(mutex_);
    orders_.push_back(std::move(order));
    there_.notify_one();
  }
  std::optional<Answer> next() {
    const std::lock_guard guard(mutex_);
    if (done_.empty()) return {};
    Answer out = std::move(done_.front());
    done_.pop_front();
    return out;
  }
  /// Until an answer is there, or a little: longer the longer nothing happens, as looking for messages costs time of a
  /// core that computes.
  void rest() {
    constexpr std::chrono::microseconds kLongest(1600);
    std::unique_lock lock(mutex_);
    ready_.wait_for(lock, pause_, [this] { return !done_.empty(); });
    pause_ = std::min(2 * pause_, kLongest);
  }
  void wake() { pause_ = kPause; }
  /// Ends what is being computed, and forgets what waits and what is done.
  void drop() {
    stop_ = true;
    while (true) {
      {
        const std::lock_guard guard(mutex_);
        busy_ -= orders_.size();
        orders_.clear();
      }
      if (busy_ == 0) break;
      std::this_thread::sleep_for(kPause);
    }
    const std::lock_guard guard(mutex_);
    done_.clear();
    stop_ = false;
  }

 private:
  void help() {
    std::unique_lock lock(mutex_);
    while (true) {
      there_.wait(lock, [this] { return over_ || !orders_.empty(); });
      if (over_) return;
      const Order order = std::move(orders_.front());
      orders_.pop_front();
      lock.unlock();
      Answer a{order.work, order.task.index, {}};
      try {
        a.evaluation = judge(study_, order.task, {1, [this] { return stop_ || (cancelled_ && cancelled_()); }});
      } catch (const std::exception& e) {
        a.evaluation = fail("OP131", fmt::format("an evaluation ended by an exception: {}", e.what()), {},
                            "this is a fault of the program: please report it with the study");
      }
      lock.lock();
      done_.push_back(std::move(a));
      ready_.notify_one();
      --busy_;
    }
  }

  const Study& study_;
  std::function<bool()> cancelled_;
  std::atomic<bool> stop_{false}, over_{false};
  std::atomic<std::size_t> busy_{0};
  std::mutex mutex_;
  std::condition_variable there_, ready_;
  std::chrono::microseconds pause_ = kPause;
  std::deque<Order> orders_;
  std::deque<Answer> done_;
  std::vector<std::thread> threads_;
};

struct Worker {
  Clock::time_point heard = Clock::now();
  std::vector<Task> has;
  bool lost = false;
};

class MpiCrew final : public Crew {
 public:
  MpiCrew(const Study& study, std::map<int, Worker>& workers, Outbox& outbox, int threads,
          std::function<bool()> cancelled)
      : study_(study),
        workers_(workers),
        outbox_(outbox),
        each_(static_cast<std::size_t>(std::max(1, threads))),
        cancelled_(cancelled),
        pool_(study, threads, std::move(cancelled)) {}

  Result<bool> work(Tasks& tasks) override {
    ++work_;
    waiting_.clear();
    done_.clear();
    out_ = 0;
    std::optional<Error> failed;
    while (!failed) {
      fetch(tasks);
      if (out_ + waiting_.size() == 0) break;
      if (out_ == 0 && waiting_.size() == 1) {  // what comes one after the other needs no messages
        const Task task = next();
        auto done = judge(study_, task, {static_cast<int>(each_), cancelled_});
        failed = done ? status_of(tasks.taken(task.index, std::move(*done))) : done.error();
        continue;
      }
      hand_out();
      bool idle = true;
      while (auto a = pool_.next()) {
        idle = false;
        if (!failed) failed = take(std::move(*a), tasks);
      }
      while (auto r = receive()) {
        idle = false;
        Worker& worker = workers_[r->from];
        worker.heard = Clock::now();
        worker.lost = false;
        if (r->tag != kResult) continue;
        Answer a = answer_of(r->message);
        if (a.work == work_) std::erase_if(worker.has, [&](const Task& t) { return t.index == a.index; });
        if (!failed) failed = take(std::move(a), tasks);
      }
      look_for_lost();
      if (cancelled_ && cancelled_() && !failed) failed = Error{kCancelled, "cancelled", {}, {}};
      idle ? pool_.rest() : pool_.wake();
    }
    for (auto& [rank, worker] : workers_) {
      worker.has.clear();
      if (failed && !worker.lost) outbox_.send(rank, kCancel);
    }
    if (!failed) return true;
    pool_.drop();
    if (failed->id == kCancelled) return false;
    return tl::unexpected(*failed);
  }

 private:
  static std::optional<Error> status_of(const Status& status) {
    return status ? std::nullopt : std::optional<Error>(status.error());
  }

  /// One more than is being computed at a time, so that no rank waits while the next one is chosen.
  void fetch(Tasks& tasks) {
    const auto ranks =
        1 + std::count_if(workers_.begin(), workers_.end(), [](const auto& w) { return !w.second.lost; });
    const std::size_t most = static_cast<std::size_t>(ranks) * each_ + 1;
    while (out_ + waiting_.size() < most) {
      std::optional<Task> task = tasks.next();
      if (!task) return;
      waiting_.push_back(std::move(*task));
    }
  }

  void hand_out() {
    while (!waiting_.empty() && pool_.busy() < pool_.size()) {
      pool_.add({work_, next()});
      ++out_;
    }
    for (auto& [rank, worker] : workers_) {
      while (!waiting_.empty() && !worker.lost && worker.has.size() < each_) {
        worker.has.push_back(next());
        ++out_;
        outbox_.send(rank, kTask, message_of(Order{work_, worker.has.back()}));
      }
    }
  }

  std::optional<Error> take(Answer a, Tasks& tasks) {
    if (a.work != work_ || !done_.insert(a.index).second) return {};  // late, or twice
    const bool waited = std::erase_if(waiting_, [&](const Task& t) { return t.index == a.index; }) > 0;
    if (!waited) --out_;  // else it is of a rank that was taken for lost
    if (!a.evaluation) return a.evaluation.error();
    return status_of(tasks.taken(a.index, std::move(*a.evaluation)));
  }

  Task next() {
    Task out = std::move(waiting_.front());
    waiting_.pop_front();
    return out;
  }

  void look_for_lost() {
    for (auto& [rank, worker] : workers_) {
      if (worker.lost || Clock::now() - worker.heard < kSilence) continue;
      worker.lost = true;
      for (Task& task : worker.has) {
        if (done_.contains(task.index)) continue;
        --out_;
        waiting_.push_front(std::move(task));
      }
      worker.has.clear();
    }
  }

  const Study& study_;
  std::map<int, Worker>& workers_;
  Outbox& outbox_;
  std::size_t each_;
  std::function<bool()> cancelled_;
  Pool pool_;
  std::int64_t work_ = 0;
  std::deque<Task> waiting_;
  std::set<std::size_t> done_;
  std::size_t out_ = 0;  ///< tasks that are being computed
};

class MpiRanks final : public Ranks {
 public:
  MpiRanks() {
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
    for (int i = 1; rank_ == 0 && i < size_; ++i) workers_[i];
  }
  MpiRanks(const MpiRanks&) = delete;
  MpiRanks& operator=(const MpiRanks&) = delete;
  ~MpiRanks() override {
    Message stop;
    stop.put(static_cast<std::int64_t>(lost()));
    for (const auto& [rank, worker] : workers_)
      if (!worker.lost) outbox_.send(rank, kStop, stop);
    // Until it has left, or nobody takes it any more.
    const auto until = Clock::now() + kSilence;
    while (!outbox_.empty() && lost() == 0 && Clock::now() < until) {
      outbox_.erase_sent();
      std::this_thread::sleep_for(kPause);
    }
    if (lost() == 0 && !without_) MPI_Finalize();  // else it would wait for those that are gone
  }

  [[nodiscard]] int rank() const override { return rank_; }
  [[nodiscard]] int size() const override { return size_; }
  [[nodiscard]] int lost() const override {
    return static_cast<int>(
        std::count_if(workers_.begin(), workers_.end(), [](const auto& w) { return w.second.lost; }));
  }

  std::unique_ptr<Crew> crew(const Study& study, const std::string& text, int threads,
                             std::function<bool()> cancelled) override {
    Message m;
    m.put(text);
    m.put(study.file);
    m.put(study.machine_toml);
    m.put(static_cast<std::int64_t>(study.seed));
    for (auto& [rank, worker] : workers_) {
      outbox_.send(rank, kStudy, m);
      worker.heard = Clock::now();
    }
    return std::make_unique<MpiCrew>(study, workers_, outbox_, threads, std::move(cancelled));
  }

  Status serve(int threads, const std::function<bool()>& cancelled) override {
    Study study;
    std::unique_ptr<Pool> pool;
    auto spoke = Clock::now();
    while (!cancelled || !cancelled()) {
      bool idle = true;
      if (auto r = receive()) {
        idle = false;
        if (r->tag == kStop) {
          without_ = r->message.integer() > 0;
          return {};
        }
        if (r->tag == kCancel && pool) pool->drop();
        if (r->tag == kTask && pool) pool->add(order_of(r->message));
        if (r->tag == kStudy) {
          const std::string text = r->message.text(), file = r->message.text(), machine = r->message.text();
          POLYPOD_ASSIGN(read, study_from_text(text, file, machine));
          pool.reset();
          study = std::move(read);
          study.seed = static_cast<std::uint64_t>(r->message.integer());
          pool = std::make_unique<Pool>(study, threads, cancelled);
        }
      }
      while (auto a = pool ? pool->next() : std::nullopt) {
        idle = false;
        send(0, kResult, message_of(*a));
        spoke = Clock::now();
      }
      if (Clock::now() - spoke > kBeat) {
        send(0, kAlive);
        spoke = Clock::now();
      }
      if (!idle && pool) pool->wake();
      if (idle && pool) pool->rest();
      if (idle && !pool) std::this_thread::sleep_for(kPause);
    }
    return {};
  }

 private:
  int rank_ = 0, size_ = 1;
  std::map<int, Worker> workers_;
  Outbox outbox_;
  bool without_ = false;  ///< of the other ranks: one of them is gone
};

}  // namespace

Result<std::unique_ptr<Ranks>> Ranks::join() {
  int given = MPI_THREAD_SINGLE;
  if (MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &given) != MPI_SUCCESS || given < MPI_THREAD_FUNNELED) {
    return fail("OP130", "MPI does not start", {}, "try `mpirun -n 2 hostname` first");
  }
  return std::make_unique<MpiRanks>();
}

}  // namespace polypod::design
