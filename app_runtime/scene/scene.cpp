// SPDX-License-Identifier: Apache-2.0
#include "sim2vr/scene/scene.hpp"

#include <algorithm>

#include "sim2vr/core/errors.hpp"

namespace sim2vr::scene {
namespace {

struct ObjectRecord {
  std::uint64_t id = 0;
  std::uint64_t parent = 0;  // 0: a root
  std::string name;
  std::string prefab;

  void fields(Archive& archive) {
    archive.field("id", id);
    archive.field("parent", parent);
    archive.field("name", name);
    archive.field("prefab", prefab);
  }
};

void expectType(Archive& archive, const Component& component) {
  std::string type(component.typeName());
  archive.field("type", type);
  if (type != component.typeName()) {
    throw EngineError("saved state: component '" + type + "' where this game has '" +
                      std::string(component.typeName()) + "'");
  }
}

}  // namespace

Scene::Scene(const TimeSettings& time) : clock_(time) {}

Scene::~Scene() = default;

GameObject& Scene::create(std::string name, GameObject* parent) {
  return createWithId(next_id_++, std::move(name), "", parent);
}

GameObject& Scene::createWithId(std::uint64_t id, std::string name, std::string prefab,
                                GameObject* parent) {
  objects_.push_back(
      std::unique_ptr<GameObject>(new GameObject(*this, id, std::move(name), std::move(prefab))));
  GameObject& object = *objects_.back();
  if (parent != nullptr) object.transform_.attachTo(&parent->transform_);
  changed();
  return object;
}

void Scene::registerPrefab(const std::string& prefab, Prefab build) {
  if (!prefabs_.emplace(prefab, std::move(build)).second) {
    throw InvalidArgument("prefab", "'" + prefab + "' twice", "a name not registered before");
  }
}

GameObject& Scene::instantiate(const std::string& prefab, std::string name, GameObject* parent) {
  const auto found = prefabs_.find(prefab);
  if (found == prefabs_.end()) {
    throw InvalidArgument("prefab", "'" + prefab + "'", "a registered prefab");
  }
  GameObject& object = createWithId(next_id_++, std::move(name), prefab, parent);
  found->second(object);
  return object;
}

void Scene::destroy(GameObject& object) {
  if (object.destroyed_) return;
  object.destroyed_ = true;
  has_destroyed_ = true;
  object.refreshEnabled();
  // By index: OnDisable may have added children.
  for (std::size_t i = 0; i < object.transform_.children().size(); ++i) {
    destroy(object.transform_.children()[i]->gameObject());
  }
}

GameObject* Scene::find(std::string_view path) const {
  const std::size_t slash = path.rfind('/');
  const std::string_view leaf = slash == std::string_view::npos ? path : path.substr(slash + 1);
  const GameObject* parent = nullptr;
  if (slash != std::string_view::npos) {
    parent = find(path.substr(0, slash));
    if (parent == nullptr) return nullptr;
  }
  for (const auto& object : objects_) {
    const Transform* up = object->transform_.parent();
    const GameObject* object_parent = up == nullptr ? nullptr : &up->gameObject();
    if (!object->destroyed_ && object->name_ == leaf && object_parent == parent) {
      return object.get();
    }
  }
  return nullptr;
}

GameObject* Scene::findById(std::uint64_t id) const {
  for (const auto& object : objects_) {
    if (object->id_ == id) return object.get();
  }
  return nullptr;
}

void Scene::addOrdered(Component& component) {
  component.sequence_ = next_sequence_++;
  const auto place = std::upper_bound(ordered_.begin(), ordered_.end(), &component,
                                      [](const Component* a, const Component* b) {
                                        if (a->executionOrder() != b->executionOrder()) {
                                          return a->executionOrder() < b->executionOrder();
                                        }
                                        return a->sequence_ < b->sequence_;
                                      });
  ordered_.insert(place, &component);
  has_unstarted_ = true;
  changed();
}

void Scene::startNewComponents() {
  while (has_unstarted_) {
    has_unstarted_ = false;
    const std::vector<Component*> snapshot = ordered_;
    for (Component* component : snapshot) {
      if (component->started_) continue;
      if (!component->on_) {
        // An object switched on later still gets its Start; keep looking for it.
        continue;
      }
      component->started_ = true;
      component->Start();
    }
  }
  for (const Component* component : ordered_) {
    if (!component->started_) has_unstarted_ = true;
  }
}

void Scene::runPhase(void (Component::*callback)()) {
  phase_ = ordered_;
  for (Component* component : phase_) {
    if (component->on_) (component->*callback)();
  }
}

void Scene::runFrame(std::int64_t time_ns, const std::function<void()>& physics_step) {
  clock_.beginFrame(time_ns);
  if (has_unstarted_) startNewComponents();
  while (clock_.beginFixedStep()) {
    runPhase(&Component::FixedUpdate);
    physics_step();
    clock_.endFixedStep();
    if (has_unstarted_) startNewComponents();
  }
  flushDestroyed();
  if (has_unstarted_) startNewComponents();
  runPhase(&Component::Update);
  if (has_unstarted_) startNewComponents();
  runPhase(&Component::LateUpdate);
  flushDestroyed();
}

void Scene::announceDestroyed(GameObject& object) {
  const Transform* parent = object.transform_.parent();
  // Made below an object that was destroyed already.
  if (parent != nullptr && parent->gameObject().destroyed_) destroy(object);
  if (!object.destroyed_ || object.destroy_announced_) return;
  object.destroy_announced_ = true;
  for (std::size_t i = 0; i < object.components_.size(); ++i) object.components_[i]->OnDestroy();
}

void Scene::flushDestroyed() {
  if (!has_destroyed_) return;
  while (has_destroyed_) {
    has_destroyed_ = false;
    // By index, and until nothing new is destroyed: OnDestroy may make and destroy objects.
    for (std::size_t i = 0; i < objects_.size(); ++i) announceDestroyed(*objects_[i]);
  }
  std::erase_if(ordered_, [](const Component* c) { return c->gameObject().destroyed(); });
  for (const auto& object : objects_) {
    if (object->destroyed_) object->transform_.detach();
  }
  std::erase_if(objects_, [](const auto& object) { return object->destroyed_; });
  changed();
}

void Scene::matchObjects(Archive& archive) {
  std::vector<ObjectRecord> records;
  for (const auto& object : objects_) {
    const Transform* parent = object->transform_.parent();
    records.push_back({object->id_, parent == nullptr ? 0 : parent->gameObject().id_, object->name_,
                       object->prefab_});
  }
  archive.field("objects", records);
  if (!archive.loading()) return;
  const auto recorded = [&records](const GameObject& object) {
    return std::any_of(records.begin(), records.end(), [&object](const ObjectRecord& record) {
      return record.id == object.id_ && record.name == object.name_ &&
             record.prefab == object.prefab_;
    });
  };
  for (const auto& object : objects_) {
    // Prefab instances are all made anew, so that their components run in the recorded order.
    const bool keep = object->prefab_.empty() && recorded(*object);
    if (!object->destroyed_ && !keep) destroy(*object);
  }
  flushDestroyed();
  for (const ObjectRecord& record : records) {
    if (findById(record.id) != nullptr) continue;
    const auto prefab = prefabs_.find(record.prefab);
    GameObject* parent = record.parent == 0 ? nullptr : findById(record.parent);
    // Children of a prefab are made by the prefab's own function, with the ids that follow its
    // root.
    if (prefab == prefabs_.end() || (record.parent != 0 && parent == nullptr)) {
      throw EngineError("saved state: object '" + record.name +
                        "' is unknown here; the state was made with another game or options");
    }
    next_id_ = record.id + 1;
    prefab->second(createWithId(record.id, record.name, record.prefab, parent));
  }
  // A prefab also makes the children that had been destroyed by then.
  for (std::size_t i = 0; i < objects_.size(); ++i) {
    if (!recorded(*objects_[i])) destroy(*objects_[i]);
  }
  flushDestroyed();
  if (objects_.size() != records.size()) {
    throw EngineError("saved state: it has " + std::to_string(records.size()) +
                      " objects, this game made " + std::to_string(objects_.size()) +
                      " of them; the state was made with another game or options");
  }
  std::sort(objects_.begin(), objects_.end(),
            [](const auto& a, const auto& b) { return a->id_ < b->id_; });
}

void Scene::fields(Archive& archive) {
  if (!archive.loading()) flushDestroyed();
  archive.field("clock", clock_);
  std::uint64_t next_id = next_id_;
  matchObjects(archive);
  archive.field("next_id", next_id);
  if (archive.loading()) next_id_ = next_id;
  for (const auto& object : objects_) {
    archive.field("transform", object->transform_);
    archive.field("active", object->active_);
    for (const auto& component : object->components_) {
      expectType(archive, *component);
      archive.field("enabled", component->enabled_);
      archive.field("on", component->on_);
      archive.field("started", component->started_);
      component->fields(archive);
    }
  }
  if (archive.loading()) {
    has_unstarted_ = true;
    changed();
  }
}

}  // namespace sim2vr::scene
